"""Parts of the diagnosis that simulate: library, campaigns, contact models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis_samples import SCATTER, LinearSimulator, loss
from planar.planar_library import PLANAR_LIBRARY
from planted import shaken_campaign
from vsr2.config import study_from_mapping
from vsr2.effects import library as full_library
from vsr2.effects import with_effects
from vsr2.effects.registry import place
from vsr2.ensemble import Hypotheses
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import (
    SET_PRIOR,
    Acting,
    draw_acting,
    draw_set,
    insensitive,
    plain_campaigns,
    simulate_campaigns,
)
from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY, AlternativeContact
from vsr2.ensemble.simulated.library import free_parameters, primary_parameters, sides, values_at
from vsr2.ensemble.simulated.look import (
    LOOK,
    Limit,
    look,
    tried_parameters,
)
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.simulation import check_trials

# --- library -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(full_library()))
def test_shares_lead_from_the_null_to_the_prior_s_end(name: str) -> None:
    effect = full_library()[name]
    free, primary = free_parameters(effect), primary_parameters(effect)
    place = [list(effect.parameters).index(p) for p in primary]
    secondary = [0.3] * (len(free) - len(primary))
    for side in sides(effect):
        blank = values_at(effect, side, [0.0] * len(primary), secondary)
        assert [blank[i] for i in place] == [p.null for p in primary]
        steps = np.array(
            [values_at(effect, side, [s] * len(primary), secondary) for s in (0.2, 0.6, 1.0)]
        )
        for i, parameter in zip(place, primary, strict=True):
            end = parameter.ppf(1.0), parameter.ppf(0.0)
            assert min(abs(steps[-1, i] - e) for e in end) < 1e-9 * max(1, abs(steps[-1, i]))
            moved = np.diff(steps[:, i])
            assert (moved > 0).all() or (moved < 0).all()


# --- campaigns -----------------------------------------------------------------------------------


LIMITS = {
    ("table_gain", "gain", -1): Limit(0.05, jumps=False),
    ("table_gain", "gain", 1): Limit(0.5, jumps=False),
    ("restitution", "energy_ratio", -1): Limit(0.001, jumps=True),
    ("restitution", "energy_ratio", 1): Limit(4.0, jumps=False),
    ("wear", "loss", 1): Limit(2.6, jumps=False),
    ("catch", "slack", 1): Limit(0.02, jumps=False),
}

FOUR = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "restitution", "wear", "catch")}


def test_what_acts_has_the_shares_of_the_prior() -> None:
    drawn = [draw_set(FOUR, LIMITS, i, 3) for i in range(3000)]
    counts = np.bincount([len(one) for one in drawn]) / 3000
    wanted = (SET_PRIOR.none, 1 - SET_PRIOR.none - SET_PRIOR.two, SET_PRIOR.two)
    # Three binomial standard errors.
    np.testing.assert_allclose(counts, wanted, atol=3 * 0.5 / np.sqrt(3000))
    names = [acting.name for one in drawn for acting in one]
    # What reaches 0.4 limits nowhere never acts; others in turn.
    assert set(names) == {"table_gain", "restitution", "catch"}
    share = np.array([names.count(n) for n in sorted(set(names))]) / len(names)
    np.testing.assert_allclose(share, 1 / 3, atol=0.03)
    order = list(FOUR)
    for one in drawn:
        place = [order.index(acting.name) for acting in one]
        assert place == sorted(set(place))
    assert draw_set(FOUR, LIMITS, 17, 3) == drawn[17], "any can be drawn alone"
    assert draw_set(FOUR, LIMITS, 17, 4) != drawn[17]


def test_sizes_are_log_uniform_in_detection_limits() -> None:
    rng = np.random.default_rng(0)
    gains = [draw_acting(FOUR, "table_gain", LIMITS, rng) for _ in range(2000)]
    for side, most in ((-1, SET_PRIOR.most), (1, 2.0)):
        sizes = np.array([one.size for one in gains if one.side == side])
        end = 1 / LIMITS["table_gain", "gain", side].share
        beyond = sizes > most * (1 + 1e-9)
        if end > most:
            # Some of a thousand, log-uniform as well, to the end of the range.
            assert beyond.mean() == pytest.approx(SET_PRIOR.beyond, abs=0.04)
            middle = np.sqrt(most * end)
            assert np.median(sizes[beyond]) == pytest.approx(middle, rel=0.25)
            assert sizes.max() <= end * (1 + 1e-9)
        else:
            assert not beyond.any()
        log = np.log(sizes[~beyond])
        low, high = np.log(SET_PRIOR.least), np.log(most)
        assert log.min() >= low - 1e-9
        assert log.max() <= high + 1e-9, "or the end of the range, where that comes first"
        assert log.mean() == pytest.approx((low + high) / 2, abs=3 * (high - low) / np.sqrt(12e3))
        assert log.std() == pytest.approx((high - low) / np.sqrt(12), rel=0.06)
    for one in gains:
        limit = LIMITS["table_gain", "gain", one.side].share
        assert one.values[0] == pytest.approx(one.side * one.size * limit * 0.15)
    jumps = [draw_acting(FOUR, "restitution", LIMITS, rng) for _ in range(300)]
    assert {one.side for one in jumps} == {-1}, "the other side reaches 0.4 limits nowhere"
    shares = np.array([one.size for one in jumps]) * 0.001
    assert SET_PRIOR.least_share <= shares.min() < 0.006
    assert 0.7 < shares.max() <= 1.0


RULE = {"outcome_rule": PLANAR_LIBRARY["outcome_rule"]}


def of_rule(tilt: Limit, flips: Limit) -> dict[tuple[str, str, int], Limit]:
    """Limits of its two primary parameters."""
    return {("outcome_rule", "tilt", 1): tilt, ("outcome_rule", "flips", 1): flips}


def drawn_rules(tilt: Limit, flips: Limit, count: int) -> list[Acting]:
    rng, limits = np.random.default_rng(1), of_rule(tilt, flips)
    return [draw_acting(RULE, "outcome_rule", limits, rng) for _ in range(count)]


def test_one_of_two_primary_parameters_acts_alone_in_half_of_the_draws() -> None:
    drawn = drawn_rules(Limit(0.1, jumps=False), Limit(0.02, jumps=False), 1000)
    tilt, flips = np.array([one.values for one in drawn]).T
    at_null = np.column_stack([np.isinf(tilt), flips == 0])
    assert not at_null.all(axis=1).any()
    # Either carries the size half the time, and the other is then missing in half of these.
    np.testing.assert_allclose(at_null.mean(axis=0), SET_PRIOR.alone / 2, atol=0.04)
    # Sizes are in the limits of the parameter that carries them: 0.02 of 0.03.
    sizes = np.array([one.size for one in drawn])
    of_flips = flips / 0.03 / 0.02
    np.testing.assert_allclose(sizes[at_null[:, 0]], of_flips[at_null[:, 0]])
    assert (sizes >= of_flips * (1 - 1e-9)).all()
    both = ~at_null.any(axis=1)
    carried = np.isclose(sizes, of_flips)[both]
    assert carried.mean() == pytest.approx(0.5, abs=0.07)


def test_a_parameter_that_shows_nowhere_carries_no_size() -> None:
    limits = of_rule(Limit(30.0, jumps=False), Limit(0.02, jumps=False))
    assert insensitive(RULE, limits) == ()
    flips = [one.values[1] for one in drawn_rules(*limits.values(), 200)]
    assert min(flips) >= SET_PRIOR.least * 0.02 * 0.03 * (1 - 1e-9)


def test_beside_what_jumps_others_keep_to_sizes_that_a_campaign_just_shows() -> None:
    drawn = drawn_rules(Limit(0.001, jumps=True), Limit(0.01, jumps=False), 400)
    sizes, flips = np.array([(one.size, one.values[1] / 0.03 / 0.01) for one in drawn]).T
    # Where flips carry the size, they go to the prior's end in some draws.
    assert flips.max() > 2 * SET_PRIOR.most
    beside = flips[(sizes > flips * (1 + 1e-9)) & (flips > 0)]
    assert beside.size > 50
    assert 0.7 * SET_PRIOR.most < beside.max() <= SET_PRIOR.most


def test_what_a_campaign_does_not_show_acts_beside_another_over_all_of_its_range() -> None:
    drawn = drawn_rules(Limit(0.1, jumps=False), Limit(3000.0, jumps=False), 1000)
    flips = np.array([one.values[1] for one in drawn]) / 0.03
    # Only the tilt carries the size, alone in half. Three standard errors of 1,000 and 500 draws.
    assert (flips == 0).mean() == pytest.approx(SET_PRIOR.alone, abs=0.05)
    quartiles = np.quantile(flips[flips > 0], [0.25, 0.5, 0.75])
    np.testing.assert_allclose(quartiles, [0.25, 0.5, 0.75], atol=0.07)


def test_a_prior_that_is_meant_as_it_stands_is_drawn_over_its_full_range() -> None:
    effects = {"registration": full_library()["registration"]}
    limits = dict.fromkeys(tried_parameters(effects), Limit(0.01, jumps=False))
    rng = np.random.default_rng(2)
    count = 4000
    drawn = [draw_acting(effects, "registration", limits, rng) for _ in range(count)]
    yaw, lean, _ = np.array([one.values for one in drawn]).T
    # The largest size in limits is a share of the range; uniform draws lie beyond in all but that.
    share = SET_PRIOR.most * 0.01
    beyond = np.abs(yaw) > share * 180
    # It is at its null where the lean acts alone.
    moved = 1 - SET_PRIOR.alone / 2
    expected = moved * SET_PRIOR.prior_share * (1 - share)
    assert beyond.mean() == pytest.approx(expected, abs=3 * 0.5 / np.sqrt(count))
    quartiles = np.quantile(np.abs(yaw[beyond]), [0.25, 0.5, 0.75])
    wanted = 180 * (share + (1 - share) * np.array([0.25, 0.5, 0.75]))
    np.testing.assert_allclose(quartiles, wanted, atol=9)
    assert {int(np.sign(one)) for one in yaw[beyond]} == {-1, 1}
    # What else the effect has beside it stays within the sizes that a campaign just shows.
    assert 0 < lean[yaw != 0].max() <= share * 3.0 + 1e-9
    for one, turn, leaning in zip(drawn, yaw, lean, strict=True):
        assert one.side == (np.sign(turn) or one.side)
        assert one.size == pytest.approx(max(abs(turn) / 180, leaning / 3) / 0.01)
    narrow = {"registration": effects["registration"].with_prior("yaw", -20.0, 20.0)}
    within = [draw_acting(narrow, "registration", limits, rng).values[0] for _ in range(500)]
    assert 15 < max(within) <= 20, "over the whole of the prior that is asked for"


def test_any_row_of_campaigns_is_the_same_alone() -> None:
    simulator = LinearSimulator({"wear": loss(40.0), "table_gain": loss(40.0)})
    with SimulationCache(simulator) as cache:
        found = look(cache, 40)
        every = simulate_campaigns(cache, found, found.responding, range(30), seed=2)
        runs = cache.simulated
        part = simulate_campaigns(cache, found, found.responding, range(12, 20), seed=2)
        assert cache.simulated == runs
        plain = plain_campaigns(cache, found.responding)
        assert cache.simulated == runs, "the look has simulated them"
    assert part.sets == every.sets[12:20]
    np.testing.assert_array_equal(part.peak_tilt, every.peak_tilt[12:20])
    np.testing.assert_array_equal(part.nuisances, every.nuisances[12:20])
    both = plain.joined(part)
    assert len(both) == LOOK.plain + 8
    assert both.gap_free[: LOOK.plain].all()
    np.testing.assert_array_equal(both.gap_free[LOOK.plain :], [not s for s in part.sets])
    # Log tilts are base, nuisance and effect: the campaigns' own sets are in them.
    for acting, tilt in zip(every.sets, every.peak_tilt, strict=True):
        change = sum(40 * SCATTER * one.values[0] / 0.15 for one in acting)
        mean = np.log(tilt).mean()
        if -3 + change < -0.3:
            assert mean == pytest.approx(-3 + change, abs=5 * SCATTER / np.sqrt(40))
    assert len(np.unique(every.nuisances)) == 30


# --- contact models ------------------------------------------------------------------------------


BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 2.0},
}

MODEL = AlternativeContact()


@pytest.fixture(scope="module")
def scene_simulator(tmp_path_factory):
    study = study_from_mapping(BOX, base=tmp_path_factory.mktemp("box"))
    shaken = shaken_campaign(4, 3, duration=1.0, pga_g=(0.6, 0.9))
    known = {name: full_library()[name] for name in ("wear", "support")}
    hypotheses = Hypotheses(known, nuisances=())
    return SceneSimulator(shaken, study, hypotheses=hypotheses, seed=3)


def test_a_draw_that_leaves_nothing_of_the_rock_has_no_outcome(scene_simulator) -> None:
    names = [p.name for p in scene_simulator.library["support"].parameters]
    gone = tuple(0.4 if name == "shrink" else 0.0 for name in names)
    asked = [Request(0, (("support", gone),), 1, 1), Request(0, (), 1, 1)]
    found = scene_simulator.run(asked)
    assert np.isnan(found.overturned[0])
    assert found.overturned[1] == scene_simulator.run(asked[1:]).overturned[0]
    assert np.isnan(scene_simulator.run(asked[:1]).overturned).all()


def test_travel_is_counted_from_where_the_record_says_that_the_table_is(tmp_path) -> None:
    """As a camera beside the table sees it: a table that does not come back takes the rock along.

    Under 0.3 g the block stands still on the table, but for what its contact gives way.
    """
    shaken = shaken_campaign(2, 2, duration=1.0, pga_g=(0.2, 0.3))
    known = {"table_saturation": full_library()["table_saturation"]}
    study = study_from_mapping(BOX, base=tmp_path)
    simulator = SceneSimulator(
        shaken, study, hypotheses=Hypotheses(known, nuisances=()), series=True, seed=3
    )
    capped = {"velocity": np.inf, "acceleration": 1.0, "return_frequency": 0.03}
    effect = simulator.library["table_saturation"]
    values = tuple(capped[p.name] for p in effect.parameters)
    asked = [Request(i, (("table_saturation", values),), 1, 1) for i in range(4)]
    found = simulator.run(asked).features
    assert found is not None
    for trial, features in zip(simulator._trials, found, strict=True):
        (driven,) = with_effects([trial], [(effect, capped)], relative_order=[0.0], sessions=["1"])
        left = driven.motion.displacement[-1] - trial.motion.displacement[-1]
        assert abs(left) > 5e-3
        assert features[-1] == pytest.approx(abs(left), abs=1e-4)


def contact(simulator, **values):
    given = {p.name: p.null for p in MODEL.parameters} | values
    (trial,) = with_effects(
        simulator._trials[:1], [(MODEL, given)], relative_order=[0.0], sessions=["1"]
    )
    return trial


def test_every_contact_model_of_the_family_is_one_that_simulates(scene_simulator) -> None:
    ends = [(p.lower, p.upper) for p in MODEL.parameters]
    rng = np.random.default_rng(0)
    corners = rng.integers(0, 2, (24, len(ends)))
    trials = [
        contact(
            scene_simulator,
            **{p.name: e[c] for p, e, c in zip(MODEL.parameters, ends, row, strict=True)},
        )
        for row in corners
    ]
    check_trials(trials)
    assert len({trial.scene.sha256 for trial in trials}) == len(np.unique(corners, axis=0))
    draws = scene_simulator.run([Request(4, (), n, 1) for n in range(7)])
    assert np.isfinite(draws.overturned).all()
    assert len(np.unique(draws.peak_tilt)) == 7


def test_a_contact_model_changes_what_it_says_and_nothing_else(scene_simulator) -> None:
    before = scene_simulator._trials[0].scene
    assert contact(scene_simulator).scene.sha256 == before.sha256, "at its null"
    rock = before.contact.rock
    seen = contact(
        scene_simulator, stiffness=-1.0, damping=0.2, margin=-0.5, sweeps=0.3, substeps=0.7,
        velocity_damping=0.03, spin_lever=0.004, impact_energy=-0.03,
    ).scene  # fmt: skip
    assert seen.contact.rock.stiffness == pytest.approx(0.1 * rock.stiffness)
    assert seen.contact.rock.damping == pytest.approx(0.1 * 10**0.2 * rock.damping)

    def lever(scene):
        """Of the pair: that of one body times the friction of the other, over both [m]."""
        one, other = scene.contact.rock, scene.contact.pedestal
        return (
            one.spinning_friction * other.lateral_friction
            + other.spinning_friction * one.lateral_friction
        )

    assert lever(seen) - lever(before) == pytest.approx(0.004)
    engine = before.engine
    assert seen.engine.collision_margin == pytest.approx(engine.collision_margin * 10**-0.5)
    assert seen.engine.solver_iterations == round(engine.solver_iterations * 10**0.3)
    assert seen.engine.substeps == 2 * engine.substeps
    assert seen.engine.linear_damping == pytest.approx(engine.linear_damping + 0.03)
    assert seen.engine.angular_damping == pytest.approx(engine.angular_damping + 0.03)
    left = seen.mechanisms.impact_energy_ratio
    assert left == pytest.approx(0.97)
    assert replace(before.mechanisms, impact_energy_ratio=left) == seen.mechanisms


def test_a_contact_model_multiplies_the_energy_that_a_cause_leaves(scene_simulator) -> None:
    given = {p.name: p.null for p in MODEL.parameters} | {"impact_energy": 0.04}
    acting = [(full_library()["restitution"], {"energy_ratio": 0.8}), (MODEL, given)]
    acting.sort(key=lambda one: place(one[0]))
    (trial,) = with_effects(
        scene_simulator._trials[:1], acting, relative_order=[0.0], sessions=["1"]
    )
    assert trial.scene.mechanisms.impact_energy_ratio == pytest.approx(0.8 * 1.04)


def test_contact_models_are_nuisances_within_their_ends(scene_simulator) -> None:
    names = tuple(f"contact_{p.name}" for p in MODEL.parameters)
    assert scene_simulator.nuisance_names == names
    for one, parameter in zip(CONTACT_FAMILY, MODEL.parameters, strict=True):
        drawn = [one.prior.value(z) for z in (-9.0, 0.0, 0.6744897501960817, 9.0)]
        span = parameter.upper - parameter.lower
        expected = parameter.lower + span * np.array([0, 0.5, 0.75, 1])
        np.testing.assert_allclose(drawn, expected, atol=1e-9)
        assert one.prior.sd == pytest.approx(span / np.sqrt(12))
