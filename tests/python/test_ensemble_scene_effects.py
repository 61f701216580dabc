"""The effects of a scene's own in the diagnosis: they are a part of the nominal simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis_samples import few_effects, few_simulations, made_trials
from planted import shaken_campaign
from vsr2.campaign import Campaign
from vsr2.config import Study, study_from_mapping
from vsr2.diagnosis import Budget, diagnose
from vsr2.diagnosis.corrected import scene_with
from vsr2.effects import apply_effects, effect, library
from vsr2.ensemble import Execution, Hypotheses, Nuisance, ProtocolCache
from vsr2.ensemble.simulated.distributions import Normal
from vsr2.ensemble.simulated.library import free_parameters
from vsr2.ensemble.simulated.nuisances import Scope, with_deviations
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import FINE_SOLVER, HALF_STEP, PERTURBED, Effects, Request
from vsr2.errors import ConfigError, DiagnosisError, Fault, GeometryError, ResultError
from vsr2.motion import Recorded
from vsr2.trial import Trial

BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 1.0},
}
STILL = with_deviations({"yaw": 0.0, "offset": 0.0})
Own = Mapping[str, Mapping[str, float]]


@pytest.fixture(scope="module")
def shaken() -> Campaign:
    return shaken_campaign(4, 5, duration=1.0, pga_g=(0.7, 1.4), session_size=5)


def scene(own: Own = {}, **changed: object) -> Study:  # noqa: B006
    return study_from_mapping({**BOX, "effects": own, **changed}, base=Path())


def simulator(shaken: Campaign, own: Own = {}, **hypotheses: object) -> SceneSimulator:  # noqa: B006
    asked = Hypotheses(**{"nuisances": (), "contact_family": (), **hypotheses})
    return SceneSimulator(shaken, scene(own), hypotheses=asked, seed=3)


def built(
    of: SceneSimulator, effects: Effects = (), nuisance: int = 0, replicate: int = 0
) -> list[Trial]:
    made = made_trials(of, effects, nuisance, replicate, range(20))
    return [made[i] for i in range(20)]


def yaws(trials: list[Trial], name: str = "placement", at: int = 0) -> list[float]:
    """Of the placement that comes at a place among the trial's effects."""
    found = [[a for a in trial.effects if a.effect.name == name][at] for trial in trials]
    return [dict(one.values)["yaw"] for one in found]


SEVERAL = {
    "friction": {"factor": 0.5}, "wear": {"loss": 0.1}, "table_gain": {"change": 0.1},
    "catch": {"slack": 8.0}, "slenderness": {"change": -0.05},
}  # fmt: skip


def test_nominal_trials_are_those_of_the_study_s_effects(shaken) -> None:
    plain, own = built(simulator(shaken)), simulator(shaken, SEVERAL)
    expected = apply_effects(
        plain, SEVERAL, relative_order=shaken.relative_order,
        sessions=[trial.session for trial in shaken.trials],
    )  # fmt: skip
    assert built(own) == expected
    for variant in (HALF_STEP, FINE_SOLVER, PERTURBED):
        acting = {applied.effect.name for applied in built(own, replicate=variant)[-1].effects}
        assert acting == set(SEVERAL)
    # Their trials are new objects each time, so nothing of them is kept.
    assert {kept.replicate for kept in own._earlier} == {0}
    requests = [Request(i, (), 0, 0) for i in range(0, 20, 3)]
    known = tuple((one, tuple(effect(one).complete(SEVERAL[one]).values())) for one in SEVERAL)
    same = simulator(shaken).run([request._replace(effects=known) for request in requests])
    found = own.run(requests)
    np.testing.assert_array_equal(found.peak_tilt, same.peak_tilt)
    assert (found.peak_tilt != simulator(shaken).run(requests).peak_tilt).any()


def test_the_identity_tells_scenes_with_other_effects_apart(shaken) -> None:
    some: list[Own] = [
        {}, {"table_gain": {"change": 0.1}}, {"table_gain": {"change": 0.1001}},
        {"outcome_rule": {"flips": 0.02}}, {"placement": {"yaw": 3.0}}, {"placement": {"yaw": 4.0}},
    ]  # fmt: skip
    known = [simulator(shaken, own, library={}).identity for own in some]
    assert len(set(known)) == len(some)
    null = simulator(shaken, {"table_gain": {"change": 0.0}}, library={}).identity
    assert null == known[0]


def test_what_a_scene_s_effect_draws_belongs_to_a_simulated_campaign(shaken) -> None:
    own = simulator(shaken, {"placement": {"yaw": 5.0}, "friction": {"factor": 0.8}})
    first = yaws(built(own))
    assert len(set(first)) == 20
    # Numerical variants and shifted starts are of the same campaign.
    for variant in (HALF_STEP, FINE_SOLVER, PERTURBED):
        assert yaws(built(own, replicate=variant)) == first
    others = [yaws(built(own, nuisance=n, replicate=r)) for n, r in ((0, 1), (1, 1), (2, 1))]
    assert not set(first) & {value for other in others for value in other}
    assert len({tuple(other) for other in others}) == 3
    # A placement that is hypothesised draws beside it, not along with it.
    more = built(own, (("placement", (5.0, 0.0)),), 1, 1)
    assert yaws(more) == others[1]
    assert abs(np.corrcoef(yaws(more), yaws(more, at=1))[0, 1]) < 0.7


def test_effects_on_top_of_the_scene_s_own(shaken) -> None:
    own = simulator(
        shaken,
        {"friction": {"factor": 0.5}, "restitution": {"energy_ratio": 0.8}},
        library={name: effect(name) for name in ("friction", "restitution")},
    )
    assert set(own.library) == {"friction", "restitution"}
    # The null of a ratio that is stated itself is the scene's.
    assert own.library["restitution"].null() == {"energy_ratio": 0.8}
    before = built(own)[0].scene.contact.rock.lateral_friction
    after = built(own, (("friction", (0.25,)),))[0].scene.contact.rock.lateral_friction
    assert after == pytest.approx(before * 0.5)


DRAWN = {name for name, one in library().items() if one.stage in ("start", "outcome")}
"""Effects that draw for each trial, or change what is noted alone."""


@pytest.mark.filterwarnings("ignore::vsr2.effects.EffectRangeWarning")
@pytest.mark.parametrize("first", sorted(library().keys() - DRAWN))
def test_a_corrected_scene_is_the_one_that_was_diagnosed(shaken, first: str) -> None:
    """Whichever effect was in the scene before, and whichever came on top."""
    few = replace(shaken, trials=tuple(shaken.trials[i] for i in (0, 19)))
    study = scene({first: stated(first)})
    compared = set()
    for name in sorted(library().keys() - DRAWN - {first}):
        # With a nuisance of the same effect they differ by rounding.
        others = tuple(one for one in STILL if one.acting.name not in (first, name))
        asked = Hypotheses({name: effect(name)}, nuisances=others)
        diagnosed = SceneSimulator(few, study, hypotheses=asked, seed=3)
        if name not in diagnosed.library:
            continue
        values = effect(name).complete(stated(name))
        on_top = made_trials(diagnosed, ((name, tuple(values.values())),), 1, 1, range(2))
        corrected = SceneSimulator(
            few, scene_with(study, {name: stated(name)}), seed=3,
            hypotheses=replace(asked, library={}),
        )  # fmt: skip
        again = made_trials(corrected, (), 1, 1, range(2))
        for i in range(2):
            assert content(again[i]) == content(on_top[i]), name
        compared.add(name)
    assert len(compared) > 15


def stated(name: str) -> dict[str, float]:
    """Half of the way to the prior's end, as a study states it."""
    one = effect(name)
    return {
        p.name: float(f"{0.5 * (p.null + p.extreme) if np.isfinite(p.null) else p.extreme:.6g}")
        for p in one.parameters
        if not p.secondary and p.prior != "fixed"
    }


def content(trial: Trial) -> tuple[object, ...]:
    """What is simulated of a trial, without what it is called."""
    start = trial.start_pose
    return (
        trial.scene.sha256, start.position, start.orientation, trial.motion.sha256,
        trial.drive, trial.settling, trial.outcome,
    )  # fmt: skip


def test_a_nuisance_multiplies_the_scene_s_own_value(shaken) -> None:
    one = Nuisance("restitution", "energy_ratio", Normal(0.0, mean=0.9), relative=True)
    own = simulator(shaken, {"restitution": {"energy_ratio": 0.8}}, nuisances=[one])
    found = built(own, nuisance=1)[0].scene.mechanisms.impact_energy_ratio
    assert found == pytest.approx(0.72)


@pytest.mark.parametrize("name", ["edge_rounding", "base_asperity", "table_pitch", "support"])
def test_what_cannot_act_twice_is_not_available(shaken, name: str) -> None:
    first = effect(name).parameters[0].name
    own = simulator(
        shaken,
        {name: {first: 0.002}},
        library={one: effect(one) for one in (name, "inertia")},
    )
    assert set(own.library) == {"inertia"}
    assert own.unavailable[name].fault is Fault.acts_already
    assert effect(name).once in str(own.unavailable[name])
    with pytest.raises(DiagnosisError, match=f"nuisance '{name}': .*cannot act twice"):
        simulator(
            shaken, {name: {first: 0.002}}, nuisances=[Nuisance(name, first, Normal(0.001, 0.0))]
        )


def test_what_comes_in_midway_is_not_available_again(shaken) -> None:
    """In the first trial nothing acts yet."""
    chipped = {"change_point": {"at": 0.5, "edge_rounding_radius": 0.002}}
    offered = {one: effect(one) for one in ("edge_rounding", "inertia", "change_point")}
    own = simulator(shaken, chipped, library=offered)
    assert set(own.library) == {"inertia", "change_point"}
    assert own.unavailable["edge_rounding"].fault is Fault.acts_already
    rounding = Nuisance("edge_rounding", "radius", Normal(0.001, 0.0))
    with pytest.raises(DiagnosisError, match=r"nuisance 'edge_rounding': .*cannot act twice"):
        simulator(shaken, chipped, nuisances=[rounding])


@pytest.mark.parametrize(
    ("acceleration", "nuisances", "open"),
    [
        (True, (), True),
        (False, (), False),
        # Noise of the motion comes last, so that the record tells the motion before.
        (
            True,
            [Nuisance("motion_noise", "displacement", Normal(0.0, mean=1e-5), Scope.TRIAL)],
            True,
        ),
    ],
)
def test_the_crossover_is_diagnosed_where_every_record_has_both_channels(
    shaken, acceleration: bool, nuisances, open: bool
) -> None:
    records = {
        name: replace(
            one,
            displacement=Recorded(one).motion(one.sample_interval).displacement[: one.size],
            acceleration=one.acceleration if acceleration else None,
        )
        for name, one in shaken.motions.items()
    }
    own = simulator(
        replace(shaken, motions=records),
        library={"input_channel": effect("input_channel")},
        nuisances=nuisances,
    )
    found = own.library["input_channel"]
    assert [p.name for p in free_parameters(found)] == [
        "low_gain", "high_gain", *(["crossover"] if open else [])
    ]  # fmt: skip
    values = tuple(3.0 if open and p.name == "crossover" else p.null for p in found.parameters)
    acting = () if not open else (("input_channel", values),)
    after = [one.motion for one in built(own, acting, nuisance=1, replicate=1)]
    assert all(("below 3 Hz" in motion.source) == open for motion in after)
    noisy = bool(nuisances)
    assert all(("noise of" in motion.source) == noisy for motion in after)


@pytest.mark.filterwarnings("ignore::vsr2.effects.EffectRangeWarning")
@pytest.mark.parametrize(
    ("own", "error", "message"),
    [
        ({"table_gian": {"change": 0.1}}, ConfigError, "box.*table_gian.*`table_gain`"),
        ({"friction": {"factor": 50.0}}, ConfigError, "effects.friction.factor: .*outside 0 to 20"),
        ({"com_offset": {"distance": 0.2}}, GeometryError, "effects.com_offset.distance"),
    ],
)
def test_an_effect_that_the_scene_cannot_have_is_refused(shaken, own, error, message) -> None:
    known = replace(
        shaken, trials=tuple(replace(t, overturned=t.order % 2 == 0) for t in shaken.trials)
    )
    with few_simulations(), pytest.raises(error, match=message):
        diagnose(known, scene(own), tier="B", budget=Budget(campaigns=24))


def test_a_gap_closes_once_its_cause_is_in_the_scene(shaken, tmp_path) -> None:
    cache = ProtocolCache(tmp_path / "cache")
    cause = {"catch": {"slack": 6.0}}
    hypotheses = Hypotheses({n: library()[n] for n in ("table_gain", "catch")}, nuisances=STILL[:3])
    truth = SceneSimulator(shaken, scene(cause), hypotheses=hypotheses, seed=5)
    given = truth.run([Request(i, (), 3, 1) for i in range(len(shaken))])
    trials = tuple(
        replace(trial, overturned=bool(given.overturned[i]), peak_tilt=float(given.peak_tilt[i]))
        for i, trial in enumerate(shaken.trials)
    )
    seen = replace(shaken, trials=trials)
    with few_simulations(), few_effects("table_gain", "catch"):
        found = {
            label: diagnose(
                seen, scene(own), tier="M", out=tmp_path / "found" / label,
                budget=Budget(campaigns=150, held_out=False),
                hypotheses=hypotheses, execution=Execution(threads=1, cache=cache),
            )
            for label, own in (("plain", {}), ("corrected", cause))
        }  # fmt: skip
    assert found["plain"].kind != "none"
    assert found["corrected"].kind == "none"
    noted = {label: one.content["provenance"] for label, one in found.items()}
    assert noted["plain"]["scene_effects"] == {}
    assert noted["corrected"]["scene_effects"] == cause
    # In one cache, neither simulations nor posteriors of the one serve the other.
    assert noted["plain"]["simulator"] != noted["corrected"]["simulator"]
    assert noted["corrected"]["budget"]["reused"] == 0
    assert len(list(cache.folder.glob("posterior-*.npz"))) == 2
    with few_simulations(), pytest.raises(ResultError, match="a diagnosis of another scene"):
        diagnose(seen, scene(cause), tier="M", out=tmp_path / "found" / "plain")
    narrow = replace(hypotheses, priors={"table_gain.change": (-0.01, 0.01)})
    for tier, asked in (("M", narrow), ("B", hypotheses)):
        with few_simulations(), pytest.raises(ResultError, match="campaign, seed, tier, prior or"):
            diagnose(
                seen, scene({}), tier=tier, hypotheses=asked, out=tmp_path / "found" / "plain"
            )  # fmt: skip
