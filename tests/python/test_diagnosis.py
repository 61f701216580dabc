"""The diagnosis from end to end: planar blocks whose cause is known, and once the real core."""

from __future__ import annotations

import itertools
import json
import sys
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from diagnosis_samples import few_simulations, made_trials, quick_training
from planar.planar_library import PLANAR_LIBRARY
from planar.planar_simulator import PlanarSimulator
from planted import observe, shaken_campaign
from vsr2.campaign import MeasurementNoise, simulate_campaign
from vsr2.config import study_from_mapping
from vsr2.diagnosis import Budget, Question, diagnose, diagnose_with, schema
from vsr2.diagnosis.how_far.held_out import HELD_OUT
from vsr2.effects import library as full_library
from vsr2.ensemble import Execution, Hypotheses, ProtocolCache, with_deviations
from vsr2.ensemble.execution import Stage
from vsr2.ensemble.noise_floor import NOISE_FLOOR
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import FINE_SOLVER, HALF_STEP, PERTURBED, Request
from vsr2.errors import DiagnosisError
from vsr2.simulation import run_batch

NAMES = ("table_gain", "com_offset", "wear", "catch")
CAMPAIGNS = 400
CATCH = ("catch", (0.12,))


class Protocol:
    """One schedule of trials of a planar block, simulated and trained once."""

    def __init__(self, folder):
        self.campaign = shaken_campaign(10, 5, duration=2.5, pga_g=(0.55, 1.15), session_size=10)
        self.truth = PlanarSimulator(self.campaign, seed=99)
        self.cache = ProtocolCache(folder)
        library = {name: PLANAR_LIBRARY[name] for name in NAMES}
        self.simulator = PlanarSimulator(self.campaign, library=library, seed=1)

    def observed(self, *effects, nuisance=2):
        return observe(self.campaign, self.truth, effects, nuisance=nuisance, tier="M",
                       seed=nuisance)  # fmt: skip

    def diagnose(self, *effects, nuisance=2, budget=None, **asked):
        return diagnose_with(
            self.simulator, self.observed(*effects, nuisance=nuisance), Question(**asked),
            cache=self.cache, budget=budget or Budget(campaigns=CAMPAIGNS),
        )  # fmt: skip


@pytest.fixture(scope="module")
def protocol(tmp_path_factory):
    with quick_training():
        yield Protocol(tmp_path_factory.mktemp("protocol"))


@pytest.fixture(scope="module")
def found(protocol):
    return protocol.diagnose(CATCH)


def without_cost(diagnosis):
    content = json.loads(diagnosis.to_json())
    content["provenance"].pop("wall_time_s")
    for key in ("simulated", "reused", "cost_s", "simulations", "allowed"):
        content["provenance"]["budget"].pop(key)
    return content


# --- what is said --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "planted", [CATCH, ("wear", (0.14,)), ("table_gain", (0.13,)), ("table_gain", (-0.13,))]
)
def test_a_strong_effect_is_named(protocol, planted) -> None:
    contents = [protocol.diagnose(planted, nuisance=n).content for n in (2, 3)]
    for content in contents:
        assert content["effects"][0]["name"] == planted[0], "it leads"
        assert content["gap"]["state"] == "found"
        assert content["effects"][0]["acts"] > 0.6
        row = content["effects"][0]["parameters"]
        (parameter,) = row.values()
        assert np.sign(parameter["median"]) == np.sign(planted[1][0])
        assert parameter["mean"] == pytest.approx(planted[1][0], rel=0.7)
        # Most of the gap closes on motions that were not seen, and not by a wrong response.
        assert content["gap"]["closure"]["value"] > 0.3
        assert content["negative_control"]["dealt"]["closure"]["value"] < 0.3
    named = [c["verdict"]["effects"] for c in contents if c["verdict"]["kind"] == "effect"]
    assert [planted[0]] in named
    assert all(names == [planted[0]] for names in named)


def test_a_campaign_without_gap_says_none(protocol) -> None:
    kinds, excess = [], []
    for nuisance in range(11, 20):
        content = protocol.diagnose(nuisance=nuisance).content
        kinds.append(content["verdict"]["kind"])
        excess.append(content["gap"]["excess"]["value"])
        assert content["gap"]["closure"]["value"] is None
        assert content["gap"]["headline"]["value"] is None
        assert (content["next_measurement"] is None) == (kinds[-1] == "none")
    # 5 % of 9 is 0.45: more than two happen once in 100.
    assert kinds.count("none") >= 7
    # The loss is the floor's on average.
    assert abs(np.mean(excess)) < 4 * np.std(excess) / np.sqrt(9)


def test_a_reference_says_how_little_none_may_have_without_an_effect(protocol) -> None:
    alone = protocol.diagnose(CATCH, budget=Budget(campaigns=CAMPAIGNS, held_out=False)).content
    assert alone["verdict"]["effects"]
    limit = alone["posterior"]["none_limit"]
    clean = protocol.observed(nuisance=11)
    other = replace(protocol.observed(CATCH, nuisance=5), name="other")

    def with_references(*references):
        return protocol.diagnose(
            CATCH, references=references, budget=Budget(campaigns=CAMPAIGNS, held_out=False)
        ).content

    calm = with_references(clean)
    (one,) = calm["provenance"]["references"]
    assert one["campaign"] == clean.name
    assert one["none"] > limit
    assert calm["verdict"] == alone["verdict"]
    codes = [one["code"] for one in calm["limits"]]
    assert "reference_differs" not in codes
    # References are judged by the library that the campaign is judged by.
    few = {"excluded": ("catch",), "budget": Budget(campaigns=CAMPAIGNS, held_out=False)}
    lacking = protocol.diagnose(CATCH, references=(clean,), **few).content
    own = protocol.diagnose(nuisance=11, **few).content["none_probability"]
    assert lacking["provenance"]["references"][0]["none"] == own != one["none"]
    # Were one with the effect known to have none, none would not be less probable without it.
    reported = with_references(clean, other)
    none = reported["provenance"]["references"][1]["none"]
    assert reported["posterior"]["none_limit"] == none < limit
    (said,) = [one for one in reported["limits"] if one["code"] == "reference_differs"]
    assert said["values"] == {"reference": "other", "probability": none}


def test_a_reference_of_other_trials_is_refused(protocol) -> None:
    clean = protocol.observed(nuisance=11)
    fewer = clean.select(np.arange(len(clean)) > 0)
    first = clean.trials[0].motion_file
    record = clean.motions[first]
    moved = replace(record, acceleration=1.05 * record.acceleration)
    stronger = replace(clean, motions=clean.motions | {first: moved})
    for reference in (fewer, stronger):
        with pytest.raises(DiagnosisError, match="references of the same trials in the same order"):
            protocol.diagnose(CATCH, references=(reference,))
    with pytest.raises(DiagnosisError, match="would be `none` by itself; give another campaign"):
        protocol.diagnose(CATCH, references=(protocol.observed(CATCH, nuisance=2),))


def test_a_scene_in_which_nothing_lifts_off_is_refused(protocol) -> None:
    weak = shaken_campaign(10, 4, duration=1.5, pga_g=(0.01, 0.02), session_size=10)
    seen = observe(weak, PlanarSimulator(weak, seed=99), nuisance=2, tier="M")
    simulator = PlanarSimulator(seen, library=protocol.simulator.library, seed=1)
    with pytest.raises(DiagnosisError, match=r"none of its 40 trials lifts off .*; drive the"):
        diagnose_with(simulator, seen, budget=Budget(campaigns=150))


def test_without_how_far_the_verdict_is_the_same(protocol, found) -> None:
    quick = protocol.diagnose(CATCH, budget=Budget(campaigns=CAMPAIGNS, held_out=False)).content
    for part in ("verdict", "sets", "effects", "where", "conformal_set_90"):
        assert quick[part] == found.content[part]
    assert quick["gap"]["before"] == found.content["gap"]["before"]
    assert quick["gap"]["closure"]["value"] is None
    assert "not_held_out" in [one["code"] for one in quick["limits"]]
    assert "not_held_out" not in [one["code"] for one in found.content["limits"]]
    assert quick["provenance"]["held_out"] is False


def test_campaigns_of_a_part_of_the_trials_are_judged_on_all(protocol, found) -> None:
    budget = Budget(campaigns=CAMPAIGNS, trials=40)
    part = protocol.diagnose(CATCH, budget=budget, waterfall=True)
    content, responding = part.content, found.content["campaign"]["responding_trials"]
    assert responding > 40
    assert content["effects"][0]["name"] == "catch"
    assert content["provenance"]["budget"]["trials"] == 40
    assert content["campaign"]["responding_trials"] == responding
    limits = {one["code"]: one for one in content["limits"]}
    assert limits["part_of_trials"]["values"] == {"count": 40, "of": 50}
    assert "part_of_trials" not in [one["code"] for one in found.content["limits"]]
    # Judged are all, by what the others of these 40 say; the waterfall is of the 40.
    judged = [row for row in part.trials if row["uncertain"]]
    assert len(judged) == responding
    assert all(np.isfinite([row["after"], row["loss_after"]]).all() for row in judged)
    assert [row["before"] for row in part.trials] == [row["before"] for row in found.trials]
    assert sum(np.isfinite(row["predicted"]) for row in part.trials) == 40
    assert content["gap"]["closure"]["value"] > 0.3
    assert without_cost(protocol.diagnose(CATCH, budget=budget, waterfall=True)) == without_cost(
        part
    )
    jsonschema.validate(json.loads(part.to_json()), schema())


def test_an_effect_that_is_left_out_is_not_named_and_nothing_else_is(protocol) -> None:
    for nuisance in (2, 3):
        content = protocol.diagnose(CATCH, nuisance=nuisance, excluded=("catch",)).content
        assert content["verdict"]["kind"] in ("unknown", "unresolved", "none")
        assert content["gap"]["excess"]["ci95"][0] > 0, "although there is a gap"
        said = json.dumps({k: content[k] for k in ("verdict", "effects", "sets")})
        assert "catch" not in said
        assert content["unknown"]["probability"] > 0.15
        assert content["provenance"]["excluded"] == ["catch"]
        assert "catch" not in content["conformal_set_90"]


def test_a_pair_leads_where_two_act(protocol) -> None:
    content = protocol.diagnose(CATCH, ("wear", (0.14,))).content
    acts = {row["name"]: row["acts"] for row in content["effects"]}
    assert sorted(acts, key=acts.get)[-2:] in (["wear", "catch"], ["catch", "wear"])
    assert set(content["sets"][0]["effects"]) <= {"wear", "catch"}
    assert content["verdict"]["kind"] != "none"
    if content["verdict"]["kind"] == "pair":
        assert content["gap"]["effects"] == content["verdict"]["effects"]


# --- the document --------------------------------------------------------------------------------


def test_the_result_follows_its_schema(found, tmp_path) -> None:
    path = found.save(tmp_path)
    content = json.loads(path.read_text())
    jsonschema.Draft202012Validator.check_schema(schema())
    jsonschema.validate(content, schema())
    assert set(content) == set(schema()["properties"])
    for part, change in (
        ("verdict", {"kind": "guess"}),
        ("verdict", {"probability": 1.2}),
        ("verdict", {"probabilty": 0.9}),
        ("gap", {"closure": {"value": 0.5}}),
        ("campaign", {"tier": "X"}),
        ("negative_control", {"dealt": 3}),
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(content | {part: content[part] | change}, schema())
    beside = content["none_probability"] + content["unknown"]["probability"]
    assert sum(e["probability"] for e in content["effects"]) + beside == pytest.approx(1)
    assert {p.name for p in tmp_path.iterdir()} >= {"effects.csv", "where.csv", "trials.csv"}
    assert len((tmp_path / "trials.csv").read_text().splitlines()) == 51


def test_what_is_written_are_the_numbers_of_the_posterior(found) -> None:
    content = found.content
    stated = [row["probability"] for row in content["sets"]]
    assert stated == sorted(stated, reverse=True)
    assert len(stated) == 10
    probabilities = [row["probability"] for row in content["effects"]]
    assert probabilities == sorted(probabilities, reverse=True)
    for row in content["effects"]:
        assert row["acts"] >= row["probability"]
        for value in row["parameters"].values():
            (low, high), (least, most) = value["ci90"], value["ci95"]
            assert least <= low <= value["median"] <= high <= most
    gap = content["gap"]
    assert gap["gain"]["value"] == pytest.approx(gap["before"]["value"] - gap["after"]["value"])
    assert gap["excess"]["value"] == pytest.approx(gap["before"]["value"] - gap["floor"]["value"])
    controls = [gap["before"]["value"]] + [
        content["negative_control"][name]["loss"]["value"] for name in ("recalibrated", "dealt")
    ]
    headline = (min(controls) - gap["after"]["value"]) / gap["excess"]["value"]
    assert gap["headline"]["value"] == pytest.approx(headline)
    rows = [row for row in found.trials if row["uncertain"]]
    assert len(rows) == content["campaign"]["responding_trials"]
    for name, key in (("before", "loss_before"), ("after", "loss_after"), ("floor", "floor")):
        assert np.mean([row[key] for row in rows]) == pytest.approx(gap[name]["value"])
    limits = content["provenance"]["detection_limits"]
    assert set(limits) == {"table_gain.gain -", "table_gain.gain +", "com_offset.offset -",
                           "com_offset.offset +", "wear.loss +", "catch.slack +"}  # fmt: skip
    assert content["posterior"]["campaigns"] == CAMPAIGNS + 48


# --- budget, cache, threads ----------------------------------------------------------------------


def test_a_second_diagnosis_neither_simulates_campaigns_nor_trains(
    protocol, found, monkeypatch
) -> None:
    trainings, gathered = [], []
    module = sys.modules["vsr2.diagnosis.pipeline"]
    train, gather = module.train, module.plain_campaigns
    monkeypatch.setattr(module, "train", lambda *a, **k: trainings.append(1) or train(*a, **k))
    monkeypatch.setattr(
        module, "plain_campaigns", lambda *a, **k: gathered.append(1) or gather(*a, **k)
    )
    again = protocol.diagnose(CATCH)
    assert again.content["provenance"]["budget"]["simulated"] == 0
    assert without_cost(again) == without_cost(found)
    other = protocol.diagnose(("wear", (0.1,)), nuisance=41)
    # The trials under what this campaign names, and the noise floor.
    most = (HELD_OUT.members + NOISE_FLOOR.runs) * 50
    assert 0 < other.content["provenance"]["budget"]["simulated"] <= most
    assert not trainings
    assert not gathered, "campaigns are for training alone"
    protocol.diagnose(nuisance=42, tier="B")
    assert len(trainings) == 1, "another tier has a posterior of its own"
    protocol.diagnose(nuisance=42, excluded=("wear", "catch"))
    assert len(trainings) == 2, "and so has another library"


def small(cache=None, report=None, seed=0):
    """A diagnosis of few campaigns, by a protocol of its own."""
    campaign = shaken_campaign(8, 5, duration=1.5, pga_g=(0.55, 1.15), session_size=10)
    seen = observe(campaign, PlanarSimulator(campaign, seed=99), (CATCH,), nuisance=2, tier="M")
    library = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "catch")}
    simulator = PlanarSimulator(seen, library=library, seed=1)
    with quick_training():
        return diagnose_with(
            simulator, seen, Question(seed=seed), budget=Budget(campaigns=150), cache=cache,
            report=report,
        )  # fmt: skip


@pytest.fixture(scope="module")
def plain():
    return small()


def stages_of(seen):
    return [stage for stage, _ in itertools.groupby(one.stage for one in seen)]


def test_sharing_reporting_and_interruptions_change_no_diagnosis(plain, tmp_path) -> None:
    seen = []

    def stop(progress):
        seen.append(progress)
        if progress.stage is Stage.SIMULATION and progress.share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        small(cache=tmp_path, report=stop)
    stages = [one.stage for one in seen]
    assert stages[0] is Stage.LOOK
    assert stages[-1] is Stage.SIMULATION
    seen.clear()
    again = small(cache=tmp_path, report=seen.append)
    assert again.content["provenance"]["budget"]["reused"] > 100 * 30
    # Those of the look are used besides, as pages and --help say.
    assert again.content["provenance"]["budget"]["campaigns"] == 150 + 48
    assert without_cost(again) == without_cost(plain)
    # What is in the cache is not tried again, and no first answer goes before the only one.
    assert stages_of(seen) == [Stage.SIMULATION, Stage.TRAINING, Stage.JUDGEMENT]
    assert seen[-1].share == 1.0
    assert max(seen[-1].leading, key=seen[-1].leading.get) == "catch"
    assert (tmp_path / "simulations.jsonl").exists()
    assert without_cost(small(seed=1)) != without_cost(plain)


def test_there_is_a_first_answer_after_a_tenth_of_the_budget() -> None:
    seen = []
    campaign = shaken_campaign(8, 5, duration=1.5, pga_g=(0.55, 1.15), session_size=10)
    observed = observe(campaign, PlanarSimulator(campaign, seed=99), (CATCH,), nuisance=2)
    library = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "catch")}
    with quick_training():
        diagnose_with(
            PlanarSimulator(observed, library=library, seed=1), observed,
            budget=Budget(campaigns=300), report=seen.append,
        )  # fmt: skip
    shares = {
        bool(one.leading): one.share for one in reversed(seen) if one.stage is Stage.SIMULATION
    }
    # The least that anything is trained on is half of so small a budget.
    assert shares[False] < shares[True] <= 200 / 300
    left = [one.left_s for one in seen if one.stage is Stage.SIMULATION]
    assert left[0] > left[-1] >= 0
    # Each training has its own name, so that none looks like simulating that stands still.
    assert stages_of(seen)[1:] == [Stage.SIMULATION, Stage.TRAINING] * 2 + [Stage.JUDGEMENT]


def test_linear_algebra_has_the_same_bits_on_any_machine() -> None:
    """Over threads BLAS sums in another order: one thread, whatever it had before."""

    def threads():
        return {b["num_threads"] for b in threadpool_info() if b["user_api"] == "blas"}

    seen = []

    def stop(progress):
        seen.append(threads())
        raise KeyboardInterrupt

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with pytest.raises(KeyboardInterrupt):
            small(report=stop)
        assert threads() == before == {2}
    assert seen == [{1}]


# --- real scenes ---------------------------------------------------------------------------------


def only(*names):
    """Hypotheses of a few effects, of which the contact model stays."""
    return Hypotheses({name: full_library()[name] for name in names}, contact_family=())


BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 3.0},
}
STILL = with_deviations({"yaw": 0.0, "offset": 0.0})


@pytest.fixture(scope="module")
def shaken():
    return shaken_campaign(5, 8, duration=2.0, pga_g=(0.6, 1.3), session_size=10)


@pytest.mark.parametrize("noise", [None, 1e-5])
def test_a_scene_that_says_nothing_of_recordings_is_driven_as_recorded(tmp_path, noise) -> None:
    """Where the campaign states noise, without it; so a simulated campaign comes out again."""
    cosines = {
        "mode": "grid_cosine",
        "pga_g": {"min": 0.5, "max": 0.6, "step": 0.1},
        "pgv_pga_s": {"min": 0.08, "max": 0.14, "step": 0.02},
    }
    study = study_from_mapping(BOX | {"motion": cosines}, base=tmp_path)
    simulated = simulate_campaign(study)
    campaign = replace(simulated, noise=MeasurementNoise(displacement=noise))
    simulator = SceneSimulator(campaign, study, hypotheses=only("wear"))
    found = simulator.run([Request(i, (), 0, 0) for i in range(len(campaign))])
    apart = np.abs(found.peak_tilt - [trial.peak_tilt for trial in campaign.trials])
    if noise is None:
        # The record comes at the simulation's own step: the motion is the same, to rounding.
        assert apart.max() < 1e-9
    else:
        # The band-pass rounds the steps at the cosines' ends.
        assert apart.max() > 0.01


def test_real_trials_answer_alike_alone_and_together(shaken, tmp_path) -> None:
    study = study_from_mapping(BOX, base=tmp_path)
    simulator = SceneSimulator(shaken, study, hypotheses=only("wear"))
    requests = [Request(i, (("wear", (0.1,)),), 2, 1) for i in (0, 20, 39)]
    together = simulator.run([*requests, Request(20, (), 2, 1), Request(20, (), 0, -1)])
    alone = simulator.run([requests[1]])
    assert alone.peak_tilt[0] == together.peak_tilt[1]
    # Wear has not begun at the first trial.
    first = simulator.run([Request(0, (), 2, 1)])
    assert first.peak_tilt[0] == together.peak_tilt[0]
    assert together.peak_tilt[3] != together.peak_tilt[1]


def test_rest_features_are_those_of_the_batch(shaken, tmp_path) -> None:
    study = study_from_mapping(BOX, base=tmp_path)
    simulator = SceneSimulator(shaken, study, hypotheses=only("off_axis_motion"), series=True)
    some = [14, 22, 37]
    given = [Request(i, (), 0, 0) for i in some]
    found = simulator.run(given)
    built = made_trials(simulator, (), 0, 0, some)
    batch = run_batch([built[i] for i in some])
    assert found.features is not None
    np.testing.assert_allclose(found.features[:, -1], batch["final_slip"], atol=1e-8)
    np.testing.assert_allclose(found.features[:, -2], np.abs(batch["final_yaw"]), atol=1e-6)
    assert (found.features[:, -1] > 0.01).all()
    # Numerical variants: near the plain ones, but not the same.
    for variant in (HALF_STEP, FINE_SOLVER, PERTURBED):
        other = simulator.run([Request(i, (), 0, variant) for i in some])
        assert (other.peak_tilt != found.peak_tilt).all()
        np.testing.assert_allclose(other.peak_tilt, found.peak_tilt, rtol=0.05)


def test_a_real_campaign_is_diagnosed(shaken, tmp_path) -> None:
    study = study_from_mapping(BOX | {"outcome": {"tail": 1.5}}, base=tmp_path)
    some = shaken.select([i % 2 == 0 for i in range(len(shaken))])
    hypotheses = replace(only("table_gain", "catch"), nuisances=STILL[:3])
    truth = SceneSimulator(some, study, hypotheses=hypotheses, seed=5)
    given = truth.run([Request(i, (("catch", (6.0,)),), 3, 1) for i in range(len(some))])
    trials = tuple(
        replace(trial, overturned=bool(given.overturned[i]), peak_tilt=float(given.peak_tilt[i]))
        for i, trial in enumerate(some.trials)
    )
    with few_simulations():
        result = diagnose(
            replace(some, trials=trials), study, out=tmp_path / "out",
            budget=Budget(campaigns=150), hypotheses=hypotheses, execution=Execution(threads=1),
        )  # fmt: skip
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    jsonschema.validate(content, schema())
    assert content["campaign"]["tier"] == "M"
    assert result.content["effects"][0]["name"] == "catch"
    layers = content["gap"]["layers"]
    assert all(0 <= layers[name] <= 1 for name in ("numerical", "time_step", "solver", "input"))
    assert content["provenance"]["nuisances"] == ["slenderness", "inertia", "com_offset"]
    files = {path.name.split("-")[0] for path in (tmp_path / "out").iterdir()}
    assert files >= {"simulations.jsonl", "posterior"}
