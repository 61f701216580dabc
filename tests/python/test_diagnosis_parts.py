"""Parts of the diagnosis on their own: bank, emulator, evidence, places, verdict."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from vsr2.diagnosis.budget import MAX_DRAWS, Budget, Schedule
from vsr2.diagnosis.diagnose import _settled
from vsr2.diagnosis.floor import _repeats
from vsr2.diagnosis.how_far.anew import ANEW_RUNS, Anew
from vsr2.diagnosis.how_far.dropped import DROPPED_RUNS
from vsr2.diagnosis.how_far.shrinkage import Interval, Pair
from vsr2.diagnosis.likelihood.emulator import design_matrix, fit_emulator
from vsr2.diagnosis.likelihood.equivalence import evened, leading_class, taken_for_same
from vsr2.diagnosis.likelihood.evidence import (
    Change,
    Data,
    Layout,
    Table,
    _Products,
    posterior,
    predict,
    tabulate,
)
from vsr2.diagnosis.likelihood.pairs import pair_posterior
from vsr2.diagnosis.observed.features import Feature, Sampling, rest_features, tilt_features
from vsr2.diagnosis.observed.observations import observe_campaign, rest_logarithm
from vsr2.diagnosis.observed.table import agreement, table_residuals
from vsr2.diagnosis.planted import shaken_campaign
from vsr2.diagnosis.simulated.bank import Bank, own_code
from vsr2.diagnosis.simulated.design import Design
from vsr2.diagnosis.simulated.library import NONE, basis, free_parameters, null_quantile, values_at
from vsr2.diagnosis.simulated.planar.library import PLANAR_LIBRARY
from vsr2.diagnosis.simulated.simulator import Request, Responses, nuisance_normal
from vsr2.diagnosis.verdict.rules import Findings, Verdict, decide, disagreement
from vsr2.diagnosis.verdict.summary import (
    _few_sessions,
    _repeated,
    _shown,
    _unrolled,
    beyond_tolerance,
    mates,
    withheld_mates,
)
from vsr2.diagnosis.where.discrepancy import COMMON, VARIANCE, disturbed
from vsr2.diagnosis.where.null_campaigns import null_campaigns
from vsr2.diagnosis.where.places import OUTCOME, Conditions, Place, scan
from vsr2.diagnosis.which.novelty import Misfit, fit_strangers
from vsr2.diagnosis.which.routes import Combination, _closed, _combination
from vsr2.diagnosis.which.tempering import (
    COVERAGE,
    Judged,
    Tempering,
    below,
    pairwise_exponent,
    sharpness,
)
from vsr2.effects import library as full_library
from vsr2.errors import DiagnosisError
from vsr2.motion import Record

TWO = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "restitution")}


class Counting:
    """A simulator that counts, and stops on request."""

    library = TWO
    nuisance_names = ("z",)
    identity = "counting"

    def __init__(self, stop_after=None):
        self.runs = 0
        self.stop_after = stop_after

    def trial_key(self, trial):
        return str(trial)

    def nuisance_draw(self, index):
        return nuisance_normal(0, 1, index)

    def run(self, requests):
        self.runs += len(requests)
        if self.stop_after is not None and self.runs > self.stop_after:
            raise KeyboardInterrupt
        value = np.array([hash((r.trial, r.nuisance, r.effects)) % 97 for r in requests]) / 97
        return Responses((value > 0.5).astype(float), value, None)


def test_an_interrupted_bank_goes_on_where_it_stopped(tmp_path) -> None:
    requests = [Request(i % 10, (), i // 10, 1) for i in range(40)]
    whole = Bank(Counting()).run(requests)
    with pytest.raises(KeyboardInterrupt), Bank(Counting(25), tmp_path / "b", chunk=10) as bank:
        bank.run(requests)
    simulator = Counting()
    with Bank(simulator, tmp_path / "b", chunk=10) as bank:
        found = bank.run([*requests, requests[3]])
        assert (bank.simulated, bank.reused, bank.size) == (20, 20, 40)
    assert simulator.runs == 20
    np.testing.assert_array_equal(found.peak_tilt[:40], whole.peak_tilt)
    assert found.peak_tilt[40] == whole.peak_tilt[3]


def test_a_bank_tells_effects_nuisances_replicates_and_scenes_apart(tmp_path) -> None:
    keys = [
        Request(0, (), 0, 0),
        Request(0, (), 1, 0),
        Request(0, (), 0, 1),
        Request(0, (("table_gain", (0.1,)),), 0, 0),
        Request(1, (), 0, 0),
    ]
    with Bank(Counting(), tmp_path / "b") as bank:
        bank.run(keys)
        assert bank.simulated == 5
    other = Counting()
    other.identity = "another scene"
    with Bank(other, tmp_path / "b") as bank:
        bank.run(keys)
        assert bank.simulated == 5


TYPED_IN = """
class Gain(library_s):
    def change(self, setup, values):
        return setup, {slope} * values["change"]
"""


def test_a_bank_tells_the_versions_of_an_effect_of_one_s_own_apart(tmp_path) -> None:
    library_s = type(full_library()["table_gain"])

    class Gain(library_s):
        """An effect of the user's, under the name of one of the library's."""

        def change(self, setup, values):
            return setup

    kinds = [library_s, Gain]
    # Of a class without a word of its own the base tells.
    kinds.append(type("Gain", (Gain,), {}))
    for slope in (1.0, 2.0):
        # As at a prompt, where no source is kept.
        names = {"library_s": library_s, "__name__": "prompt"}
        exec(TYPED_IN.format(slope=slope), names)
        kinds.append(names["Gain"])
    assert own_code(kinds[0]) == ""
    with_it, without = Request(0, (("table_gain", (0.1,)),), 0, 0), Request(0, (), 0, 0)
    simulated = []
    for kind in (*kinds, *kinds):
        simulator = Counting()
        simulator.library = TWO | {"table_gain": kind()}
        with Bank(simulator, tmp_path / "b") as bank:
            bank.run([with_it, without])
            simulated.append(bank.simulated)
    # What no effect acts on is simulated once for all of them.
    assert simulated == [2, 1, 0, 1, 1, 0, 0, 0, 0, 0]


def test_only_effects_in_the_race_get_twice_the_draws() -> None:
    schedule = Schedule(Budget(simulations=100_000), Bank(Counting()), 50, TWO)
    told = {"table_gain": 0.9, "restitution": 0.001}
    first = dict.fromkeys(TWO, 24)
    more = schedule.next_draws(first, told)
    assert more == {"table_gain": 48, "restitution": 24}
    # Who fell behind once stays behind.
    assert schedule.next_draws(more, dict.fromkeys(TWO, 0.5)) == {
        "table_gain": 96,
        "restitution": 24,
    }
    assert schedule.next_draws({"table_gain": MAX_DRAWS, "restitution": 24}, told) is None


def test_what_dropped_trials_cost_is_kept_back() -> None:
    bank = Bank(Counting())
    schedule = Schedule(Budget(simulations=10_000), bank, 50, TWO)
    schedule.fit(20)
    rest = 10_000 - DROPPED_RUNS * 30 - ANEW_RUNS * 20
    assert schedule.affords(rest, bank)
    assert not schedule.limited
    assert not schedule.affords(rest + 1, bank)
    assert schedule.limited
    bank.run([Request(0, (), i, 1) for i in range(10)])
    assert not schedule.affords(rest - 9, bank)
    assert schedule.affords(rest - 10, bank)


def test_an_answer_stands_on_three_rounds_with_one_class_and_one_test() -> None:
    def one(group: list[str], p: float) -> SimpleNamespace:
        return SimpleNamespace(leading=group, inference=SimpleNamespace(gap_p=0.5, direction_p=p))

    same = [one(["catch", "table_gain"], 0.01), one(["catch"], 0.02), one(["catch"], 0.001)]
    assert _settled(same)
    assert not _settled(same[1:])
    assert _settled([one(["wear"], 0.5), *same]), "of the last three"
    assert not _settled([*same[:2], one(["wear"], 0.01)])
    assert not _settled([*same[:2], one(["catch"], 0.03)]), "a gap, and then none"


def test_a_file_that_is_no_bank_is_refused(tmp_path) -> None:
    (tmp_path / "b").write_text("no bank at all, and long enough to be looked at" * 20)
    with pytest.raises(DiagnosisError, match="choose another folder"):
        Bank(Counting(), tmp_path / "b")


@pytest.mark.parametrize("name", sorted(full_library()))
def test_the_basis_vanishes_where_an_effect_is_absent(name: str) -> None:
    entry = full_library()[name]
    free = free_parameters(entry)
    nulls = [null_quantile(p) for p in free]
    primary = [null for p, null in zip(free, nulls, strict=True) if not p.secondary]
    if any(null is None or not 1e-6 < null < 1 - 1e-6 for null in primary):
        # Presence itself is one of the functions of an effect with one side.
        assert basis(entry, np.full((1, len(free)), 0.5)).shape[1] >= len(free)
        return
    u = np.array([[0.3 if null is None else null for null in nulls]])
    np.testing.assert_allclose(basis(entry, u), 0.0, atol=1e-9)
    assert len(values_at(entry, u[0])) == len(entry.parameters)


def logistic_design(rng, rows=400, trials=12, bend=0.0):
    """Outcomes and a feature that follow the emulator's own form.

    bend: by which the first nuisance's square moves the feature, from -1 to 1 times over trials.
    """
    names = np.where(np.arange(rows) % 2 == 0, "", "table_gain")
    quantiles = tuple(rng.random(1) if name else np.zeros(0) for name in names)
    z = rng.standard_normal((rows, 2))
    c = np.array([basis(TWO["table_gain"], u)[0, 0] if u.size else 0.0 for u in quantiles])
    intercept = np.linspace(-2, 2, trials)
    logit = intercept + z @ np.array([[1.0], [0.0]]) + 3.0 * c[:, None]
    y = (rng.random((rows, trials)) < 1 / (1 + np.exp(-logit))).astype(float)
    feature = 0.5 * intercept + 0.3 * z[:, 1:] - 1.0 * c[:, None]
    feature = feature + bend * np.linspace(-1, 1, trials) * (z[:, :1] ** 2 - 1)
    feature = feature + 0.1 * rng.standard_normal((rows, trials))
    return Design(names, quantiles, z, y, feature[..., None])


def test_the_emulator_finds_what_made_the_data() -> None:
    design = logistic_design(np.random.default_rng(0), rows=1200)
    found = fit_emulator(TWO, design)
    gain = found.blocks["table_gain"].start
    error = np.sqrt(np.diagonal(found.outcome.covariance, axis1=1, axis2=2))
    off = (found.outcome.mean[:, [1, 2, gain]] - [1.0, 0.0, 3.0]) / error[:, [1, 2, gain]]
    assert np.abs(off).mean() < 1.5  # 0.8 for errors that are stated rightly
    np.testing.assert_allclose(found.features[0].mean[:, gain], -1.0, atol=0.05)
    # What no campaign held stays at the prior's mean.
    assert np.abs(found.outcome.mean[:, found.blocks["restitution"]]).max() < 1e-6


def test_the_evidence_agrees_with_brute_force() -> None:
    rng = np.random.default_rng(1)
    design = logistic_design(rng)
    emulator = fit_emulator(TWO, design)
    table = tabulate(emulator, "table_gain")
    one = Data(design.overturned[1:4], np.full((3, 12, 1), np.nan))
    z = rng.standard_normal((10_000, table.nuisances))
    at = table.fine.logit[::5], table.fine.factor[::5]
    logit = at[0][:, None, :] + at[1][:, None, :] * table.slope(z)[None]
    p = 0.004 + 0.992 / (1 + np.exp(-logit))
    for c in range(3):
        y = one.overturned[c]
        likelihood = np.exp((np.log(p) * y + np.log1p(-p) * (1 - y)).sum(axis=2)).mean()
        # Laplace's error with twelve trials; the brute force's own is below 0.04.
        assert posterior(table, one).evidence[c] == pytest.approx(np.log(likelihood), abs=0.1)


def test_nodes_close_in_on_a_pair() -> None:
    rng = np.random.default_rng(7)
    rows, trials = 300, 40
    names = np.array(["", "table_gain", "restitution"])[np.arange(rows) % 3]
    quantiles = tuple(rng.random(1) if name else np.zeros(0) for name in names)
    x, blocks = design_matrix(TWO, list(names), quantiles, rng.standard_normal((rows, 2)))
    ways = {"table_gain": np.ones(trials), "restitution": np.linspace(-1, 1, trials)}
    shown = sum(x[:, blocks[name]][:, :1] * way for name, way in ways.items())
    blank = np.full((rows, trials), np.nan)
    features = shown + 0.1 * rng.standard_normal((rows, trials))
    emulator = fit_emulator(TWO, Design(names, quantiles, x[:, 1:3], blank, features[..., None]))
    true = {"table_gain": 0.9, "restitution": 0.2}
    both = sum(basis(TWO[n], np.array([[u]]))[0, 0] * ways[n] for n, u in true.items())
    seen = both + 0.1 * rng.standard_normal(trials)
    one = Data(blank[:1], seen[None, :, None])

    def told(*nodes):
        return pair_posterior(TWO, emulator, ("table_gain", "restitution"), one, nodes)

    table, near = told(120, 120, 120)
    assert near.evidence[0] == pytest.approx(told(400, 400, 400)[1].evidence[0], abs=0.05)
    # Of 4000 nodes over both priors a few share the posterior: a third of the evidence is chance.
    assert near.evidence[0] == pytest.approx(told(4000)[1].evidence[0], abs=0.4)
    assert near.evidence[0] > told(120)[1].evidence[0] + 5, "which 120 nodes hardly meet"
    mean = np.exp(near.nodes[0]) @ table.fine.quantiles
    np.testing.assert_allclose(mean, list(true.values()), atol=0.1)
    assert np.exp(near.nodes[0]).max() < 0.1, "many nodes share the posterior"


def test_a_pair_names_what_stands_behind_its_members() -> None:
    pair = Verdict("pair", ("catch", "com_offset"), 0.9, ())
    assert [told.split(",")[0] for told in mates(pair, full_library())] == [
        "in place of catch it may be outcome_rule",
        "in place of com_offset it may be base_slope",
    ]
    assert mates(Verdict("pair", ("inertia", "time_scale"), 0.9, ()), full_library()) == []
    assert mates(Verdict("effect", ("com_offset",), 0.9, ()), full_library()) == []


def test_what_lies_beyond_its_tolerance_may_look_like_an_effect() -> None:
    nuisances = ("slenderness", "inertia", "friction")

    def told(kind, *effects):
        return beyond_tolerance(Verdict(kind, effects, 0.9, ()), nuisances)

    assert "whose slenderness lies further off" in told("effect", "edge_rounding")[0]
    assert "whose slenderness or inertia lies" in told("class", "table_gain", "time_scale")[0]
    assert "whose friction lies" in told("effect", "friction")[0]
    assert told("effect", "catch") == told("none") == told("unresolved", "slenderness") == []


def shared_draws(rng, draws=30, each=20, trials=60, common=0.3, own=0.1):
    """Campaigns of which `each` share a draw of nuisances, and with it most of their noise.

    The effect is weak beside it.
    """
    names = np.array(["", "table_gain"])[np.arange(draws * each) % 2]
    quantiles = tuple(rng.random(1) if name else np.zeros(0) for name in names)
    z = rng.standard_normal((draws, 2))
    c = np.array([basis(TWO["table_gain"], u)[0, 0] if u.size else 0.0 for u in quantiles])
    shift = common * rng.standard_normal((draws, trials))
    index = np.repeat(np.arange(draws), each)
    logit = (0.3 * z[:, :1] + 4 * shift)[index] + 0.5 * c[:, None]
    y = (rng.random(logit.shape) < 1 / (1 + np.exp(-logit))).astype(float)
    feature = (0.3 * z[:, :1] + shift)[index] - 0.1 * c[:, None]
    feature = feature + own * rng.standard_normal(feature.shape)
    return Design(names, quantiles, z[index], y, feature[..., None])


def standardised(found, columns, true, fit) -> float:
    """Root mean square error of coefficients over their stated standard errors."""
    error = np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2))[:, columns]
    return float(np.sqrt(np.mean(((fit.mean[:, columns] - true) / error) ** 2)))


def test_campaigns_that_share_a_draw_are_no_independent_witnesses() -> None:
    design = shared_draws(np.random.default_rng(5))
    found = fit_emulator(TWO, design)
    feature = found.features[0]
    # 60 coefficients: 1 with a standard error of 0.09.
    assert standardised(found, [1], 0.3, feature) < 1.3
    assert standardised(found, [1], 0.3, found.outcome) < 1.3
    # A fresh campaign scatters by both kinds of noise.
    # The scale of Student's t that fits a normal distribution best is 0.86 of its own.
    assert np.sqrt(np.median(feature.scatter)) == pytest.approx(0.86 * np.hypot(0.3, 0.1), rel=0.1)
    assert np.sqrt(found.outcome.noise[0]) == pytest.approx(1.2, rel=0.25)
    # Taken for independent, they seem to know four times more than they do.
    moved = design.nuisances + 1e-9 * np.random.default_rng(6).standard_normal((600, 2))
    alone = fit_emulator(TWO, dataclasses.replace(design, nuisances=moved))
    assert standardised(alone, [1], 0.3, alone.features[0]) > 2.5


def test_effects_are_known_from_differences_within_draws() -> None:
    design = shared_draws(np.random.default_rng(7))
    found = fit_emulator(TWO, design)
    gain = found.blocks["table_gain"].start
    feature = found.features[0]
    off = feature.mean[:, gain] + 0.1
    moved = design.nuisances + 1e-9 * np.random.default_rng(6).standard_normal((600, 2))
    alone = fit_emulator(TWO, dataclasses.replace(design, nuisances=moved)).features[0]
    # The noise within draws is a third of the whole; the prior pulls both errors in.
    assert np.abs(off).mean() < 0.7 * np.abs(alone.mean[:, gain] + 0.1).mean()
    # 60 coefficients: 1 with a standard error of 0.09, and what the prior pulls.
    assert standardised(found, [gain], -0.1, feature) < 1.4


def test_nuisances_that_act_by_their_square_are_found_and_no_others() -> None:
    bent = fit_emulator(TWO, logistic_design(np.random.default_rng(3), bend=0.2))
    np.testing.assert_array_equal(bent.bends, [0])
    change = tabulate(bent, "").response[0]
    np.testing.assert_allclose(change.square[:, 0], np.linspace(-0.2, 0.2, 12), atol=0.03)
    plain = fit_emulator(TWO, logistic_design(np.random.default_rng(3)))
    assert plain.bends.size == 0


def test_a_square_left_out_is_taken_for_an_effect() -> None:
    design = logistic_design(np.random.default_rng(4), rows=800, trials=40, bend=0.2)
    far = np.flatnonzero((design.effect == "") & (np.abs(design.nuisances[:, 0]) > 1.8))
    data = Data(design.overturned[far], design.features[far])
    favoured = {}
    for bends in ([0], []):
        emulator = dataclasses.replace(
            fit_emulator(TWO, design), bends=np.array(bends, dtype=np.int64)
        )
        none, gain = (posterior(tabulate(emulator, name), data) for name in ("", "table_gain"))
        favoured[len(bends)] = np.mean(gain.evidence > none.evidence + 3)
    assert favoured[1] == 0
    assert favoured[0] > 0.1


def test_derivatives_by_nuisances_are_those_of_differences() -> None:
    rng = np.random.default_rng(0)
    change = Change(rng.standard_normal((5, 4)), np.array([0, 2]), rng.standard_normal((5, 2)))
    z, weight = rng.standard_normal((3, 2, 4)), rng.random((3, 2, 5))
    step = 1e-6 * np.eye(4)
    slope = np.stack([(change(z + s) - change(z - s)) / 2e-6 for s in step], axis=-1)
    np.testing.assert_allclose(change.at(z), slope, atol=1e-8)
    np.testing.assert_allclose(
        change.back(z, weight), np.einsum("cgt,cgti->cgi", weight, slope), atol=1e-8
    )
    hessian = np.zeros((3, 2, 4, 4))
    _Products(change).add(hessian, z, weight)
    by_hand = np.einsum("cgt,cgti,cgtj->cgij", weight, slope, slope)
    np.testing.assert_allclose(hessian, by_hand, atol=1e-7)


def test_held_out_predictions_are_better_with_the_true_effect() -> None:
    design = logistic_design(np.random.default_rng(2))
    emulator = fit_emulator(TWO, design)
    rows = np.flatnonzero([u.size > 0 and abs(u[0] - 0.5) > 0.4 for u in design.quantiles])
    data = Data(design.overturned[rows], design.features[rows])
    seen = data.only(np.arange(12) % 2 == 0)
    score = {}
    for name in ("", "table_gain"):
        table = tabulate(emulator, name)
        found = predict(table, posterior(table, seen))
        p, y = found.probability[:, 1::2], data.overturned[:, 1::2]
        score[name] = float((y * np.log(p) + (1 - y) * np.log1p(-p)).mean())
    assert score["table_gain"] > score[""] + 0.05


def test_features_of_a_series() -> None:
    time = np.arange(0, 4, 0.01)
    tilt = np.where((time > 1) & (time < 2), 0.1 * np.sin(np.pi * (time - 1)), 0.0)
    tilt += np.where((time > 2.1) & (time < 2.6), 0.04 * np.sin(np.pi * (time - 2.1) / 0.5), 0.0)
    found = tilt_features(time, np.stack([tilt, np.zeros_like(tilt)], axis=1))
    assert found[0, 0] == pytest.approx(1.04, abs=0.02)
    np.testing.assert_allclose(np.exp(found[0, [1, 3]]), [0.1, 0.04], rtol=0.01)
    assert found[0, 4] == pytest.approx(2.56, abs=0.02)
    assert np.isnan(found[1]).all()


# --- WHERE --------------------------------------------------------------------------------------


def schedule(sessions=10, each=12, seed=0):
    rng = np.random.default_rng(seed)
    count = sessions * each
    return Conditions(
        log_pga=rng.normal(size=count),
        log_ratio=rng.normal(size=count),
        order=np.arange(count) / (count - 1),
        session=np.repeat(np.arange(sessions), each),
        motion=np.repeat(np.arange(count // 6), 6),
        specimen=np.zeros(count, dtype=np.int64),
        sessions=tuple(f"day {i + 1}" for i in range(sessions)),
        specimens=("rock",),
    )


def places(residual, conditions, seed=0):
    count = conditions.order.size
    variance = np.full((1, 1, count), 0.21)
    null = (np.random.default_rng(9).random((150, 1, count)) < 0.3) - 0.3
    return scan(
        (residual[None, None], variance),
        (null, np.broadcast_to(variance, null.shape)),
        conditions,
        (OUTCOME,),
        seed=seed,
    )


def test_two_sessions_cannot_show_a_change_over_the_order() -> None:
    """Half of the permutations leave all as it was; rounding must not tell them from the score."""
    there = schedule(sessions=2, each=42)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        p = np.where(there.session == 1, 0.3 + rng.uniform(0.2, 0.6), 0.3)
        found = places((rng.random(p.size) < p) - 0.3, there, seed)
        ordered = [place.p_familywise for place in found if place.axis == "order"]
        # 999 draws of one half: four standard deviations are 0.06.
        assert min(ordered) > 0.43


def test_a_session_is_judged_by_whole_motions() -> None:
    """Trials of a motion err together: permuting them singly would make every session stand out."""
    there, found = schedule(), 0
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        p = np.repeat(rng.choice([0.0, 0.6], there.motion.max() + 1), 6)
        sessions = [
            place.p_familywise
            for place in places((rng.random(p.size) < p) - 0.3, there, seed)
            if place.axis == "session"
        ]
        found += min(sessions) <= 0.05
    # One in twenty, of twenty: more than four happen less than one time in 300.
    assert found <= 4


def test_the_order_of_one_session_is_judged_by_whole_motions() -> None:
    there = dataclasses.replace(
        schedule(),
        session=np.zeros(120, dtype=np.int64),
        sessions=("day 1",),
        motion=np.repeat(np.arange(5), 24),
    )
    found = 0
    for seed in range(40):
        rng = np.random.default_rng(200 + seed)
        p = np.repeat(rng.choice([0.0, 0.6], 5), 24)
        told = places((rng.random(p.size) < p) - 0.3, there, seed)
        found += min(place.p_familywise for place in told if place.axis == "order") <= 0.05
    # One in twenty, of forty: more than six happen less than one time in 300.
    assert found <= 6
    # A trend that motions do not carry is found, and none is sought where they are interleaved.
    rising = np.random.default_rng(3).random(120) < 0.1 + 0.8 * there.order
    short = dataclasses.replace(there, motion=np.repeat(np.arange(20), 6))
    mixed = dataclasses.replace(there, motion=np.arange(120) % 20)
    first, second = (
        next(place for place in places(rising - 0.3, one) if place.axis == "order")
        for one in (short, mixed)
    )
    assert first.p_familywise <= 0.05
    assert second.p_familywise == 1.0


def test_few_sessions_are_told() -> None:
    def told(*sessions, motion=(0, 0, 1, 1)):
        return _few_sessions(SimpleNamespace(session=np.array(sessions), motion=np.array(motion)))

    assert "one session: a change" in told(0, 0, 0, 0)[0]
    assert "motions of one session are" in told(0, 0, 0, 0, motion=(0, 1, 0, 1))[0]
    assert "sessions are interleaved" in told(0, 1, 0, 1)[0]
    assert "2 sessions: their order can be changed in 2 ways" in told(0, 0, 1, 1)[0]
    assert "(p of 0.17 at least)" in told(0, 0, 1, 1, 2, 2)[0]
    assert told(0, 0, 1, 1, 2, 2, 3, 3) == []


def test_a_trend_over_sessions_is_found() -> None:
    there = schedule()
    rng = np.random.default_rng(4)
    p = 0.3 + 0.65 * there.order
    found = places((rng.random(p.size) < p) - 0.3, there)
    ordered = [place for place in found if place.axis == "order"]
    assert ordered[0].p_familywise <= 0.05
    assert ordered[0].effect_size > 0


def test_sessions_that_merely_differ_are_no_trend() -> None:
    there = schedule(sessions=18, each=8)
    shuffled = np.random.default_rng(0).permutation(there.motion)
    there = dataclasses.replace(there, motion=shuffled)
    fired = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        p = np.clip(0.3 + 0.25 * rng.standard_normal(18), 0.02, 0.98)[there.session]
        found = places((rng.random(p.size) < p) - 0.3, there, seed)
        fired += min(q.p_familywise for q in found if q.axis == "order") <= 0.05
    # 5 % of 80 is 4. With permutations within sessions among the others it is 8.
    assert fired <= 6


def test_nothing_is_found_where_nothing_is() -> None:
    there = schedule()
    fired = 0
    for seed in range(12):
        y = np.random.default_rng(100 + seed).random(there.order.size) < 0.3
        fired += places(y - 0.3, there, seed)[0].p_familywise <= 0.05
    assert fired <= 3


def test_turn_and_travel_are_those_between_the_rests() -> None:
    rows = 40
    half = 0.5 * np.linspace(0.0, 0.3, rows).clip(0, 0.2)
    orientation = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    position = np.tile([0.13, -0.04, 0.0], (rows, 1))
    tilt, table = np.zeros(rows), np.full(rows, 0.1)
    # A quaternion and its negative are one orientation.
    for sign in (1.0, -1.0):
        found = rest_features(tilt, position, sign * orientation, table)
        np.testing.assert_allclose(found, [0.2, 0.05], rtol=1e-9)
    np.testing.assert_allclose(rest_features(None, position, orientation, None), [0.2, np.nan])
    assert np.isnan(rest_features(tilt + 1.2, position, orientation, table)).all()


def test_creep_below_the_resolution_is_taken_for_none() -> None:
    size = np.array([0.0, 0.004, 0.0099, 0.02, np.nan])
    found = rest_logarithm(size, 0.01, 0.0001)
    np.testing.assert_allclose(np.exp(found), [0.01, 0.01, 0.01, 0.02, np.nan])
    # A coarse instrument resolves less.
    np.testing.assert_allclose(np.exp(rest_logarithm(size, 0.01, 0.01))[3], 0.03)


def straight(linear) -> Change:
    """Of nuisances that do not act by their squares."""
    return Change(linear, np.zeros(0, dtype=np.int64), np.zeros((len(linear), 0)))


def test_drawn_null_campaigns_hang_together_as_the_engine_s_do() -> None:
    """One nuisance moves all trials: the drawn deviation of sums must show it."""
    trials, q = 60, 1
    at = Layout(
        np.zeros((1, 0)),
        np.zeros((1, trials)),
        np.ones((1, trials)),
        (np.zeros((1, trials)),),
        (np.full((1, trials), 0.25),),
    )
    table = Table(
        NONE,
        at,
        at,
        np.ones((1, 1)),
        straight(np.full((trials, q), 2.0)),
        (straight(np.full((trials, q), 0.5)),),
        (np.full(trials, 1e-3),),
    )
    rng = np.random.default_rng(1)
    half = (rng.random((50, trials)) < 0.5).astype(float)
    features = np.where(half > 0.5, np.nan, 0.0)[..., None]
    drawn = null_campaigns(table, Data(half, features), count=4000)
    # Overturned: sigma(2 z) has mean 1/2 and standard deviation 0.323 over z ~ N(0, 1).
    share = drawn.overturned.mean(axis=1)
    assert share.mean() == pytest.approx(0.5, abs=0.02)
    assert share.std() == pytest.approx(np.hypot(0.323, 0.38 / np.sqrt(trials)), abs=0.01)
    # A feature is known where the rock stood, as in the engine's campaigns.
    assert np.array_equal(np.isfinite(drawn.features[..., 0]), drawn.overturned < 0.5)
    # 0.5 z plus Student's noise of scale 0.5 and 4 degrees of freedom (variance 2 x 0.25); of
    # those that stood z has mean -E[z tanh z] and second moment 1.
    z = np.linspace(-8, 8, 4001)
    normal = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    mean = float(normal @ (z * np.tanh(z)))
    expected = np.sqrt(0.25 * (1 - mean**2) + 0.5)
    assert np.nanstd(drawn.features) == pytest.approx(expected, abs=0.02)


def test_drawn_nulls_resolve_what_few_simulated_ones_cannot() -> None:
    there = schedule()
    count = there.order.size
    rng = np.random.default_rng(3)
    variance = np.ones((1, 1, count))
    null, drawn = rng.normal(size=(40, 1, count)), rng.normal(size=(999, 1, count))
    wide = [np.broadcast_to(variance, part.shape) for part in (null, drawn)]
    residual = rng.normal(size=(1, 1, count)) + np.where(there.log_pga > 0.5, 2.0, 0.0)

    def smallest(drawn_null):
        found = scan((residual, variance), (null, wide[0]), there, (OUTCOME,), drawn=drawn_null)
        return found[0].p_familywise

    assert smallest(None) == pytest.approx(1 / 41)
    assert smallest((drawn, wide[1])) == pytest.approx(1 / 1000)
    # Deviations are the simulated ones': drawn campaigns of twice the size say the same.
    assert smallest((2 * drawn, wide[1])) == pytest.approx(1 / 1000)


def recorded(gain=1.0, delay=0.0, corner=0.0, seed=0, interval=0.005, noise=2e-6):
    """A shaken table: displacement and acceleration of a pulse train, with their noise.

    The accelerometer is late, scaled, and passes nothing slow (first order, `corner` in Hz).
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 8.0, interval)
    displacement = sum(
        0.02 * np.exp(-(((time - at) / 0.35) ** 2)) * np.sin(2 * np.pi * f * (time - at))
        for at, f in ((2.0, 1.1), (3.5, 2.3), (5.0, 3.1))
    )
    frequency = np.fft.rfftfreq(time.size, interval)
    # Of the second difference, which is what a sampled displacement tells, gain restored.
    spectrum = -((2 * np.pi * frequency) ** 2) * np.fft.rfft(displacement)
    spectrum *= gain * np.exp(-2j * np.pi * frequency * delay)
    if corner:
        spectrum *= 1j * frequency / (1j * frequency + corner)
    acceleration = np.fft.irfft(spectrum, time.size)
    return Record(
        name="table",
        sample_interval=interval,
        displacement=displacement + noise * rng.standard_normal(time.size),
        acceleration=acceleration + 0.02 * rng.standard_normal(time.size),
    )


def test_two_recordings_of_a_table_check_each_other() -> None:
    gain_slow, _, gain_fast, phase_fast = agreement(recorded(gain=1.03, delay=0.004))
    for value, error in (gain_slow, gain_fast):
        assert value == pytest.approx(np.log(1.03), abs=4 * error)
        assert error < 0.01
    # Most of the fast power is at 2 to 4 Hz, where 4 ms are 0.05 to 0.1 rad.
    assert -0.1 < phase_fast[0] < -0.05
    one = dataclasses.replace(recorded(), acceleration=None)
    assert np.isnan(agreement(one)).all()


def test_an_accelerometer_that_passes_nothing_slow_leads_and_is_low_there() -> None:
    found = agreement(recorded(corner=0.3))
    gain_slow, phase_slow, gain_fast, phase_fast = found[:, 0]
    # 1 / (1 - 0.3i / f) from 0.5 to 2 Hz: between 14 and 1 % low, ahead by 31 to 8.5 degrees.
    assert -0.16 < gain_slow < -0.01
    assert np.radians(8.5) < phase_slow < np.radians(31)
    assert -0.012 < gain_fast < 0.002
    assert 0.02 < phase_fast < np.radians(8.6)


def test_fast_noise_of_the_displacement_hides_no_band() -> None:
    """Sampled 800 times a second, noise of 0.02 mm is 30 m/s^2 of its second difference."""
    found = agreement(recorded(gain=1.1, interval=0.00125, noise=2e-5))
    gain_slow, _, gain_fast, _ = found
    for value, error in (gain_slow, gain_fast):
        assert value == pytest.approx(np.log(1.1), abs=4 * error)


@pytest.mark.parametrize("last", [True, False])
def test_the_ends_of_a_record_tell_nothing_of_the_instruments(last) -> None:
    """A cosine's ends are steps, which fill the fast bands."""
    time = np.arange(0.0, 6.0, 0.005)
    omega = 2 * np.pi * 0.9
    acceleration = 2.0 * np.cos(omega * time)
    acceleration[-1] *= last
    one = Record(
        name="cosine",
        sample_interval=0.005,
        displacement=2.0 / omega**2 * (1 - np.cos(omega * time)),
        acceleration=acceleration,
    )
    gain_slow, phase_slow, *fast = agreement(one)
    # Instruments in order are taken to differ by 0.01.
    assert np.abs([gain_slow[0], phase_slow[0]]).max() < 0.005
    assert np.abs(np.nan_to_num(fast)).max() < 0.01


def test_noise_alone_makes_recordings_differ_by_their_standard_errors() -> None:
    found = np.stack([agreement(recorded(seed=seed)) for seed in range(60)])
    over = found[:, :, 0] / found[:, :, 1]
    # The mean of 60 within 0.5; errors may be too large, by half, but hardly too small.
    assert np.abs(over.mean(axis=0)).max() < 0.5
    deviation = over.std(axis=0)
    assert (deviation > 0.5).all()
    assert (deviation < 1.25).all()


def table_campaign(*records):
    """Eight trials of each record."""
    plain = shaken_campaign(len(records), 8, duration=2.0)
    ids = sorted({trial.motion for trial in plain.trials})
    return dataclasses.replace(
        plain,
        trials=tuple(dataclasses.replace(t, motion_file=t.motion) for t in plain.trials),
        motions=dict(zip(ids, records, strict=True)),
    )


def test_the_table_s_residuals_are_those_that_its_null_expects() -> None:
    calm = table_residuals(table_campaign(*(recorded(seed=s) for s in range(5))), null=400)
    assert calm is not None
    assert calm.residual.shape == calm.variance.shape == (4, 40)
    assert calm.null.shape == (400, 4, 40)
    assert (calm.variance == 1).all()
    np.testing.assert_allclose(calm.null.std(axis=(0, 2)), 1.0, atol=0.12)
    # Noise far below the calibration error: all records of a null campaign err together.
    assert (calm.null.mean(axis=2).std(axis=0) > 0.85).all()
    assert np.abs(calm.residual).max() < 1.5
    off = [recorded(gain=1.03, seed=s) for s in range(4)]
    one = dataclasses.replace(recorded(), acceleration=None)
    loud = table_residuals(table_campaign(*off, one), null=400)
    assert loud is not None
    known = loud.variance[0] > 0
    assert known.sum() == 32
    # ln(1.03) over 1 % and less noise.
    expected = np.log(1.03) / np.hypot(0.01, agreement(off[0])[0, 1])
    assert loud.residual[0, known].mean() == pytest.approx(expected, abs=0.4)
    assert (loud.residual[:, ~known] == 0).all()
    assert (loud.null[:, :, ~known] == 0).all()
    assert table_residuals(table_campaign(one, one, one, one), null=9) is None


def test_no_axis_and_no_channel_is_left_out_of_the_places_shown() -> None:
    table, tilt = Feature("gain", "table", "whole motion"), OUTCOME
    many = [Place(f"condition {i}", "conditions", table, 1.0, 0.01) for i in range(40)]
    late = [
        Place("second half", "order", tilt, 0.5, 0.2),
        Place("last third", "order", tilt, 0.4, 0.3),
        Place("all trials", "conditions", tilt, 0.1, 0.9),
    ]
    shown = [place.place for place in _shown(many + late)]
    assert shown == [*(f"condition {i}" for i in range(20)), "second half", "all trials"]


# --- the verdict --------------------------------------------------------------------------------

CLEAR = Findings(
    gap_low=0.02,
    touches_floor=False,
    gap_p=0.005,
    surprise_p=1.0,
    direction_p=0.005,
    none_probability=0.01,
    none_in_set=True,
    leading=("table_gain",),
    alike=("table_gain",),
    alike_probability=0.9,
    offered=20,
    class_probability=0.9,
    agreement=None,
    pair_agreement=None,
    novelty_p=0.5,
    unknown_probability=0.9,
    favoured="table_gain",
    after_low=-0.01,
    floor=0.05,
    left=0.1,
    left_of_all=0.1,
    pair=None,
    halves=(),
)


BOTH = Pair(("table_gain", "wear"), probability=1.0, left=0.4, closed=0.6, beyond=0.4)
SECOND = {"pair": BOTH, "novelty_p": 0.15, "after_low": 0.01, "left": 0.5}
MISFIT = {"novelty_p": 0.01, "after_low": 0.01, "left": 0.5}
FAINT = {"gap_low": -0.01, "direction_p": 0.3, "none_probability": 0.06, "unknown_probability": 0.1}


def second(**changes):
    return {"pair": dataclasses.replace(BOTH, **changes)}


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({}, "effect"),
        ({"leading": ("table_gain", "slenderness")}, "class"),
        ({"gap_low": -0.01, "direction_p": 0.3}, "unresolved"),
        (
            {
                "gap_low": -0.01,
                "direction_p": 0.3,
                "none_probability": 0.03,
                "unknown_probability": 0.1,
            },
            "none",
        ),
        ({"gap_low": -0.01, "direction_p": 0.3, "none_probability": 0.03}, "unresolved"),
        ({"gap_low": -0.01, "direction_p": 0.005}, "effect"),
        ({"novelty_p": 0.01, "after_low": 0.01, "left": 0.5}, "unknown"),
        (
            {"novelty_p": 0.01, "after_low": 0.01, "left": 0.5, "unknown_probability": 0.25},
            "unresolved",
        ),
        ({"novelty_p": 0.09, "after_low": 0.01, "left": 0.3}, "unresolved"),
        ({"novelty_p": 0.11, "after_low": 0.01, "left": 0.3}, "effect"),
        ({"novelty_p": 0.09, "after_low": -0.01, "left": 0.3}, "effect"),
        ({"novelty_p": 0.01, "after_low": 0.01}, "effect"),
        ({"novelty_p": 0.01}, "effect"),
        ({"after_low": 0.01}, "effect"),
        ({"after_low": 0.01, "left": 0.9}, "unresolved"),
        ({"after_low": 0.01, "left_of_all": 0.9}, "unresolved"),
        ({"gap_low": -0.01, "direction_p": 0.3, "surprise_p": 0.004}, "effect"),
        ({"gap_low": -0.01, "direction_p": 0.3, "surprise_p": 0.006}, "unresolved"),
        ({"after_low": -0.01, "left": 0.9}, "effect"),
        ({"agreement": "the routes disagree"}, "unresolved"),
        ({"halves": (("table_gain",), ("table_gain", "wear"))}, "effect"),
        ({"after_low": 0.16}, "unresolved"),
        ({"after_low": 0.14}, "effect"),
        ({"anew": Anew(Interval(0.9, 0.8, 1.0), 0.9, short=False)}, "effect"),
        ({"anew": Anew(Interval(0.3, 0.2, 0.4), 0.9, short=True)}, "unresolved"),
        (SECOND | {"anew": Anew(Interval(0.3, 0.2, 0.4), 0.9, short=True)}, "unresolved"),
        ({"halves": (("table_gain",), ("wear", "catch"))}, "unresolved"),
        ({"halves": (("wear",), ("table_gain",)), "leading": ("table_gain", "wear")}, "class"),
        (SECOND | {"halves": (("table_gain",), ("wear", "catch"))}, "pair"),
        # A gap whose size is not told from zero has no cause that is named, however it is told.
        ({"touches_floor": True}, "unresolved"),
        (SECOND | {"touches_floor": True}, "unresolved"),
        (MISFIT | {"touches_floor": True}, "unresolved"),
        (FAINT | {"touches_floor": True}, "none"),
        (
            {
                "novelty_p": 0.01,
                "after_low": 0.01,
                "left": 0.5,
                "none_probability": 0.5,
                "unknown_probability": 0.32,
            },
            "unresolved",
        ),
        ({"leading": tuple("abcde")}, "class"),
        ({"leading": tuple("abcdef")}, "unresolved"),
        ({"pair": BOTH}, "effect"),
        (SECOND, "pair"),
        (SECOND | {"agreement": "the routes disagree"}, "pair"),
        (SECOND | {"pair_agreement": "the routes disagree"}, "unresolved"),
        # A pair that is not named excuses no contradiction.
        (SECOND | second(closed=0.4) | {"agreement": "the routes disagree"}, "unresolved"),
        (SECOND | {"novelty_p": 0.3}, "effect"),
        (SECOND | {"after_low": -0.01}, "effect"),
        (SECOND | {"left": 0.1}, "effect"),
        (SECOND | second(closed=0.4), "effect"),
        (SECOND | second(left=0.6), "effect"),
        (MISFIT | second(closed=0.4), "pair"),
        (MISFIT | second(closed=0.4, beyond=0.24), "unresolved"),
        (SECOND | second(beyond=-0.1), "pair"),
        # The tests find no gap, and yet none is not among the answers that hold the truth.
        (FAINT, "none"),
        (FAINT | {"none_in_set": False}, "unresolved"),
        (MISFIT | second(left=0.6), "unresolved"),
    ],
)
def test_the_verdict_follows_its_rules(changes, kind) -> None:
    assert decide(dataclasses.replace(CLEAR, **changes)).kind == kind


def test_what_is_less_probable_is_not_called_indistinguishable() -> None:
    two = dataclasses.replace(CLEAR, leading=("table_gain", "wear"), alike_probability=0.7)
    assert (
        "table_gain has a probability of 0.70 if something is missing; 0.8 takes"
        in decide(two).reasons[-1]
    )
    same = dataclasses.replace(two, alike=two.leading)
    assert decide(same).reasons[-1] == "this campaign does not tell these effects apart"
    many = dataclasses.replace(two, leading=tuple("abcdef"), alike=("a", "b"))
    assert (
        "the class of a has a probability of 0.70 if something is missing; it takes 6"
        in decide(many).reasons[-1]
    )
    flat = dataclasses.replace(many, alike=many.leading)
    assert "6 of the library's 20 effects cannot be told apart" in decide(flat).reasons[-1]


def test_a_gap_is_told_by_the_tests_that_found_it() -> None:
    calm = dataclasses.replace(CLEAR, gap_low=-0.01, direction_p=0.3, surprise_p=0.001)
    first, *others = decide(calm).reasons
    assert first.startswith("trials did what they never do in simulations")
    assert not others
    both = decide(dataclasses.replace(CLEAR, surprise_p=0.001)).reasons
    assert both[0].startswith("a gap beyond noise: p = 0.005 for its size")
    assert both[1] == first


def test_no_gap_with_a_favoured_effect_says_so() -> None:
    verdict = decide(
        dataclasses.replace(
            CLEAR, gap_low=-0.01, direction_p=0.3, none_probability=0.2, unknown_probability=0.1
        )
    )
    assert verdict.kind == "none"
    assert verdict.reasons[1].startswith("weighed by its prior, table_gain or another effect")
    outside = dataclasses.replace(
        CLEAR, gap_low=-0.01, direction_p=0.3, none_probability=0.2, unknown_probability=0.3
    )
    assert "prior, a cause outside the library, table_gain or" in decide(outside).reasons[1]
    calm = dataclasses.replace(
        CLEAR, gap_p=0.4, direction_p=0.3, none_probability=0.9, unknown_probability=0.1
    )
    assert len(decide(calm).reasons) == 1


def test_novelty_is_measured_among_campaigns_alike() -> None:
    rng = np.random.default_rng(0)
    strength = np.repeat([1.0, 1000.0], 100)
    # Strong effects fit worse, because the emulator is off by a share of them.
    statistics = rng.normal(size=(200, 1)) + np.where(strength > 10, 3.0, 0.0)[:, None]
    misfit = Misfit(statistics, np.zeros(200, dtype=np.int64), strength, np.ones(200))
    # Of label 1 there is none, so that strength alone tells which are alike.
    weak = misfit.p_value(np.array([3.0]), 1, 1.0)
    assert weak <= 1 / 40
    assert 0.3 < misfit.p_value(np.array([3.0]), 1, 1000.0) < 0.7


def test_probability_of_a_stranger_rests_on_those_that_were_left_out() -> None:
    rng = np.random.default_rng(2)
    count = 4000
    known = rng.random(count), np.exp(rng.normal(2, 1, count))
    weight = np.ones(count)
    # Strangers' p values have density 0.2 p^-0.8: the likelihood ratio.
    strange = rng.random(count) ** 5, np.exp(rng.normal(2, 1, count))
    gaps = np.ones(count, dtype=bool)
    seen = fit_strangers(known, weight, strange, gaps)
    at = np.array([0.01, 0.1, 0.6])
    ratio = 0.2 * at**-0.8
    expected = 0.15 * ratio / (0.15 * ratio + 0.85)
    np.testing.assert_allclose(seen.probability(at, np.full(3, 7.0)), expected, atol=0.04)
    # P(p <= 0.05) = 0.05^0.2.
    assert seen.noticed == pytest.approx(0.05**0.2, abs=0.03)
    # Strangers that look like all others: nothing is learnt beyond the prior.
    alike = (rng.random(count), strange[1])
    same = fit_strangers(known, weight, alike, gaps)
    np.testing.assert_allclose(same.probability(at, np.full(3, 7.0)), 0.15, atol=0.04)
    none = fit_strangers(known, weight, (np.zeros(0), np.zeros(0)), np.zeros(0, dtype=bool))
    assert none.noticed is None
    assert none.probability(np.array(0.01), np.array(5.0)) == pytest.approx(0.15)


def test_routes_that_contradict_each_other_are_told() -> None:
    assert disagreement(("a",), "a", "b", ("a", "b"), ("b", "a")) is None
    assert disagreement(("a",), "a", "b", ("a",), ("b",)) is not None
    assert disagreement(("a",), "a", "b", ("a",), ("b", "a")) is not None


def test_the_prior_counts_in_full_however_little_the_data_do() -> None:
    prior = np.log([0.6, 0.3, 0.1])
    ratio = np.array([0.0, 2.0, -1.0])
    flat = np.full(3, -np.log(3))
    mute = Combination(Tempering(0.0, 0.0), 0.0, np.inf, 0.0)
    np.testing.assert_allclose(mute.log_probability(prior + ratio, flat, prior), prior)
    # Half of the evidence: odds are prior odds times the square root of the likelihood's ratio.
    half = Combination(Tempering(0.5, 0.0), 0.2, np.inf, 1.0)
    found = half.log_probability(prior + ratio, flat, prior)
    assert found[1] - found[0] == pytest.approx(np.log(0.5) + 1.0)
    # Against an effect another power counts.
    assert found[2] - found[0] == pytest.approx(np.log(0.1 / 0.6) - 0.2)


def test_no_evidence_speaks_against_an_effect_beyond_the_limit() -> None:
    prior = np.log([0.6, 0.3, 0.1])
    flat = np.full(3, -np.log(3))
    limited = Combination(Tempering(0.5, 0.0), 0.5, 3.0, 1.0)
    sure = prior + np.array([0.0, -2000.0, -5000.0])
    found = limited.log_probability(sure, flat, prior)
    np.testing.assert_allclose(found - found[0], prior - prior[0] - [0.0, 3.0, 3.0], atol=1e-12)
    # Small ratios count as they are.
    near = prior + np.array([0.0, -0.2, -0.1])
    found = limited.log_probability(near, flat, prior)
    np.testing.assert_allclose(found - found[0], prior - prior[0] - [0, 0.1, 0.05], atol=2e-3)
    # What speaks for an effect is not limited.
    found = limited.log_probability(prior + np.array([0.0, 80.0, 20.0]), flat, prior)
    np.testing.assert_allclose(found - found[0], prior - prior[0] + [0, 40.0, 10.0], atol=1e-9)


def test_sure_evidence_that_misleads_one_time_in_ten_is_not_believed_more() -> None:
    rng = np.random.default_rng(3)
    labels, rows = 6, 600
    truth = np.arange(rows) % labels
    prior = np.full(labels, -np.log(labels))
    favoured = np.where(np.arange(rows) % 10 == 0, rng.integers(0, labels, rows), truth)
    likelihood = 3.0 * rng.standard_normal((rows, labels)) + prior
    likelihood[np.arange(rows), favoured] += 60.0
    likelihood -= np.log(np.exp(likelihood).sum(axis=1, keepdims=True))
    flat = np.full((rows, labels), -np.log(labels))
    found = _combination(likelihood, flat, prior, truth, np.ones(rows))
    p = np.exp(found.log_probability(likelihood, flat, prior))
    right = (favoured == truth).mean()
    assert p.max(axis=1).mean() == pytest.approx(right, abs=0.01)


def test_the_pairwise_exponent_undoes_a_claim() -> None:
    """Log likelihood ratios of mean D have variance 2 D; here they are told eight times too large.

    600 campaigns: the standard error of the exponent is about 0.005.
    """
    rng = np.random.default_rng(5)
    truth = np.arange(600) % 4
    apart = rng.uniform(0.2, 3.0, (600, 4))
    ratio = apart + np.sqrt(2 * apart) * rng.standard_normal((600, 4))
    evidence = -8.0 * ratio
    evidence[np.arange(600), truth] = 0.0
    assert pairwise_exponent(evidence, truth) == pytest.approx(1 / 8, abs=0.02)
    assert pairwise_exponent(0.5 * evidence / 8.0, truth) == 1.0
    assert pairwise_exponent(evidence[:, :1], np.zeros(600, dtype=np.int64)) == 1.0


def test_another_simulator_s_features_differ_alike_within_a_motion() -> None:
    motion = np.repeat(np.arange(40), 5)
    scatter = np.full((200, 2), [0.04, 9.0])
    plain = np.zeros((30, 200, 2))
    plain[0, 3] = np.nan
    found = disturbed(plain, scatter, motion, np.random.default_rng(0))
    assert np.isnan(found[0, 3]).all()
    z = found[1:] / np.sqrt(scatter)
    # 29 x 40 motions of 5 trials: the standard error of the variance is about 0.02.
    assert z.var() == pytest.approx(VARIANCE, abs=0.08)
    means = z.reshape(29, 40, 5, 2).mean(axis=2)
    # A motion's mean has the common part and a fifth of the other.
    assert means.var() == pytest.approx(VARIANCE * (COMMON + (1 - COMMON) / 5), abs=0.06)


def test_a_class_grows_until_it_is_probable() -> None:
    probability = {"none": 0.2, "a": 0.4, "b": 0.1, "c": 0.2, "d": 0.1}
    assert leading_class(probability, [["a", "b"], ["c"], ["d"]]) == (
        ("a", "c", "b"),
        pytest.approx(0.875),
    )
    members, within = leading_class(probability | {"a": 0.6}, [["a", "b"], ["c"], ["d"]])
    assert members == ("a", "b")
    assert within == pytest.approx(0.875)


def test_members_of_a_class_that_are_ruled_out_are_not_named() -> None:
    probability = {"none": 0.0, "a": 0.9, "b": 0.0998, "c": 0.0002}
    assert leading_class(probability, [["a", "b", "c"]])[0] == ("a", "b")


def test_what_theory_takes_for_the_same_is_named_down_to_a_tenth_of_that() -> None:
    probability = {"none": 0.0, "a": 0.995, "b": 0.003, "c": 0.002}
    groups = [["a", "b", "c"]]
    assert leading_class(probability, groups, {})[0] == ("a",)
    assert leading_class(probability, groups, {"b": ("a",)})[0] == ("a", "b")
    # Only where the campaign does not tell them apart, and not without end.
    assert leading_class(probability, [["a", "c"], ["b"]], {"b": ("a",)})[0] == ("a",)
    ruled_out = probability | {"b": 0.0004}
    assert leading_class(ruled_out, groups, {"b": ("a",)})[0] == ("a",)


def test_no_odds_are_stated_within_a_class_that_its_separation_does_not_allow() -> None:
    # b is taken for the same as a, and so is f, which evidence rules out; c is only in the class.
    probability = {"none": 0.1, "a": 0.69, "b": 0.0099, "c": 0.1, "f": 0.0001, "d": 0.1}
    groups, alike = [["a", "c", "b", "f"], ["d"]], {"a": ("b", "d", "f")}
    assert taken_for_same(probability, groups[0], alike) == ["a", "b"]
    found = evened(probability, groups, alike)
    assert found["a"] / found["b"] == pytest.approx(9.0)
    assert found["a"] + found["b"] == pytest.approx(0.6999)
    unchanged = ("none", "c", "f", "d")
    assert {n: found[n] for n in unchanged} == {n: probability[n] for n in unchanged}
    even = probability | {"a": 0.4, "b": 0.2999}
    assert evened(even, groups, alike) == pytest.approx(even), "odds that are allowed stay"


def test_a_set_that_holds_one_of_the_same_holds_all() -> None:
    assert _closed(("c", "a"), ["a", "b"]) == ("c", "a", "b")
    assert _closed(("c", "none"), ["a", "b"]) == ("c", "none")


def test_what_was_left_out_may_stand_behind_what_is_named() -> None:
    effect = Verdict("effect", ("table_resonance",), 0.9, ())
    told = withheld_mates(effect, ("catch", "table_pitch"))
    assert len(told) == 1
    assert told[0].startswith("table_pitch, which theory takes for about the same as table_reson")
    assert withheld_mates(effect, ("catch",)) == []
    assert withheld_mates(Verdict("unknown", (), 0.9, ()), ("table_pitch",)) == []


def test_repeats_that_scatter_beyond_the_simulations_are_told() -> None:
    def told(share, expected):
        return _repeated({"physical": share, "physical_expected": expected, "repeats": 30})

    # Three standard deviations of 3 expected are 5.2: 8.2 of 30.
    assert told(8 / 30, 0.1) == []
    assert "of 30 pairs of repeats 30% end otherwise, where the simulations" in told(0.3, 0.1)[0]
    assert told(3 / 30, 0.0) == [], "as if one were expected where none is"
    assert len(told(5 / 30, 0.0)) == 1
    assert "no repeats" in _repeated({"physical": None})[0]


def test_angles_are_averaged_as_directions() -> None:
    found = _unrolled(np.array([350.0, 10.0, 30.0]), np.array([0.25, 0.5, 0.25]), 360.0)
    np.testing.assert_allclose(found, [-10, 10, 30], atol=1e-9)
    assert np.array([0.25, 0.5, 0.25]) @ found == pytest.approx(10.0)
    # Beyond half a turn: about a mean of 300 degrees, 60 lies at 420.
    found = _unrolled(np.array([290.0, 310.0, 60.0]), np.array([0.5, 0.5, 1e-9]), 360.0)
    np.testing.assert_allclose(found, [290, 310, 420], atol=1e-6)


def test_simulated_series_are_measured_as_the_campaign_was() -> None:
    time = np.arange(0, 2, 0.01)
    tilt = 0.1 * np.sin(np.pi * time).clip(0)
    coarse, seen = Sampling(0.05, 0.0).measured(time, tilt, None)
    np.testing.assert_allclose(np.diff(coarse), 0.05)
    np.testing.assert_allclose(seen, tilt[::5], atol=1e-12)
    noisy = Sampling(0.05, 0.002).measured(time, tilt, np.random.default_rng(1))[1]
    assert 0.001 < (noisy - seen).std() < 0.003
    assert (noisy >= 0).all()


def test_a_strong_effect_counts_less() -> None:
    tempering = Tempering(power=0.5, error=0.1)
    # S^2 = 0 and 2 * 50.
    weights = tempering.weight(np.array([[0.0, -1.0, -3.0], [-50.0, 0.0, -2.0]]))
    np.testing.assert_allclose(weights, [0.5, 0.5 / 2])


@pytest.mark.parametrize("true_error", [0.05, 0.15])
def test_posteriors_are_tempered_until_their_intervals_cover(true_error) -> None:
    """Posteriors that claim an error of 0.05 of the range where it is 0.05, and where 0.15."""
    rng = np.random.default_rng(0)
    grid = (np.arange(121) + 0.5) / 121
    campaigns = []
    for truth in rng.uniform(0.3, 0.7, 300):
        seen = truth + true_error * rng.standard_normal()
        nodes = -0.5 * ((grid - seen) / 0.05) ** 2
        likelihood = np.array([0.0, rng.uniform(1, 50)])
        node = int(np.argmin(np.abs(grid - truth)))
        campaigns.append(Judged(nodes, grid[:, None], node, np.array([truth]), likelihood))
    best, found = sharpness(campaigns)

    def covered(tempering) -> float:
        inside = 0
        for one in campaigns:
            log = float(tempering.weight(one.likelihood)) * one.nodes
            weight = np.exp(log - log.max())
            share = below(grid, weight / weight.sum(), one.truth[0])
            inside += 0.025 <= share <= 0.975
        return inside / len(campaigns)

    assert covered(found) >= COVERAGE
    # The exponent that undoes the claim is (0.05 / error)^2; its neighbours may cover.
    power = (0.05 / true_error) ** 2
    middle = np.array([0.0, 25.0])
    assert 0.4 * power < found.weight(middle) <= 1.6 * power
    assert 0.4 * power < best.weight(middle) <= 1.6 * power
    if true_error > 0.1:
        assert covered(Tempering(1.0, 0.0)) < 0.6


def test_repeats_are_known_by_their_recordings() -> None:
    """One motion again with a recording of its own, of nearly the same size, is a repeat."""
    plain = shaken_campaign(5, 8, duration=1.5, pga=(0.1, 1.6))
    trials = [dataclasses.replace(trial, overturned=False) for trial in plain.trials]
    motions = dict(plain.motions)

    def again(of: int, factor: float, **changes: object) -> None:
        record = motions[str(trials[of].motion_file)]
        name = f"again{len(trials)}"
        motions[name] = dataclasses.replace(
            record, name=name, acceleration=record.acceleration * factor
        )
        added = {"trial": name, "order": len(trials), "motion_file": name} | changes
        trials.append(dataclasses.replace(trials[of], **added))

    def found() -> tuple[list[int], int]:
        blocks = dict.fromkeys(["block", "another"], plain.specimens["block"])
        campaign = dataclasses.replace(
            plain, trials=tuple(trials), motions=motions, specimens=blocks
        )
        repeated, differ = _repeats(observe_campaign(campaign, "B"))
        return repeated.tolist(), int(differ.sum())

    assert found() == ([], 0)
    again(7, 1.015)
    assert found() == ([7], 0)
    again(7, 1.01, overturned=True)
    assert found() == ([7, 7, 40], 2), "three trials are three pairs, and the last differs from two"
    again(7, 1.05)
    again(7, 1.01, motion="another")
    again(7, 1.01, specimen="another")
    assert found() == ([7, 7, 40], 2), "another amplitude, another motion, another block"
    again(20, 1.0, motion_file=trials[20].motion_file, overturned=True)
    assert found() == ([7, 7, 20, 40], 3), "one motion file twice"


def test_a_motion_that_does_not_move_is_named() -> None:
    plain = shaken_campaign(5, 8, duration=1.5)
    trials = tuple(dataclasses.replace(trial, overturned=False) for trial in plain.trials)
    name = str(trials[7].motion_file)
    rest = dataclasses.replace(
        plain.motions[name], acceleration=np.zeros_like(plain.motions[name].acceleration)
    )
    campaign = dataclasses.replace(plain, trials=trials, motions=plain.motions | {name: rest})
    with pytest.raises(DiagnosisError, match=rf"rests in the motion '{name}' of trial 'T007'"):
        observe_campaign(campaign)


def test_intervals_cover_in_the_weaker_half_too() -> None:
    """Of weak campaigns 91 % hold the truth untempered, of strong ones all: together enough."""
    rng = np.random.default_rng(7)
    grid = (np.arange(401) + 0.5) / 401
    campaigns = []
    for i in range(1200):
        centre, weak = rng.uniform(0.4, 0.6), i % 2 == 0
        truth = centre + rng.normal(0.0, 0.0289 if weak else 0.008)
        nodes = -0.5 * ((grid - centre) / 0.025) ** 2
        strength = 1.0 + 0.001 * i if weak else 100.0 + i
        campaigns.append(
            Judged(
                nodes - np.log(np.exp(nodes).sum()),
                grid[:, None],
                int(np.argmin(np.abs(grid - truth))),
                np.array([truth]),
                np.array([-strength / 2, 0.0]),
            )
        )
    _, intervals = sharpness(campaigns)
    # Powers are a factor 1.39 apart: 0.72 makes intervals 1.18 times as wide; 1.16 is needed.
    assert intervals.weight(np.array([-0.5, 0.0])) == pytest.approx(0.72, abs=0.01)
