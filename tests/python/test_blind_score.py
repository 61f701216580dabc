"""Scores of hand-made verdicts, computed by hand."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blind_check import pool_packs
from blind_results import committed_verdicts
from blind_samples import diagnosis, effect, hand_made, same_folders
from vsr2.blind import score_pack
from vsr2.blind.custodian.engine import build_engine
from vsr2.blind.form.diagnosis_form import Location, read_verdict, verdict_of
from vsr2.blind.form.seal import open_key
from vsr2.blind.scoring.cases import groups, read_cases
from vsr2.blind.scoring.intervals import (
    Score,
    area_under_roc,
    calibration_error,
    calibration_noise,
    proportion,
    resampled,
)
from vsr2.blind.scoring.score import (
    ANSWER,
    CALIBRATION_NOISE,
    FIRST,
    GAIN,
    NAMED,
    SILENT_CLOSURE,
    axis_named,
    closure,
    magnitude,
    pair_found,
    size,
    where_mass,
)
from vsr2.blind.scoring.tables import Scored, format_scores
from vsr2.config import load_study
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.errors import BlindError

ROOT = Path(__file__).resolve().parents[2]
TOLD = {"change": {"mean": 0.12, "ci95": [0.08, 0.16], "unit": "1"}}

CAMPAIGNS = {
    # right, by its class: slenderness for table_gain
    "a": ("single", [effect("table_gain", 0.1, 3.0)]),
    # right, magnitude told: |0.12 - 0.16| / 0.16 = 0.25, its interval holds 0.16
    "b": ("single", [effect("restitution", 0.16, 5.0)]),
    # wrong, second in the list
    "c": ("single", [effect("friction", -0.2, 2.5)]),
    # missed: weak
    "d": ("single", [effect("inertia", 0.05, 0.7)]),
    "e": ("none", []),
    "f": ("none", []),
    "g": ("unknown", [effect("catch")]),
    "h": ("unknown", [effect("wear")]),
    "i": ("pair", [effect("wear"), effect("friction")]),
}
VERDICTS = {
    "a": diagnosis(
        "class",
        {"slenderness": 0.5, "table_gain": 0.3, "friction": 0.1, "unknown": 0.05},
        ["slenderness", "table_gain"],
        ["slenderness", "table_gain"],
        closure=0.6,
        table_gain={"closure": 0.8},
        where=[{"place": "x", "axis": "conditions", "p_familywise": 0.01, "trials": ["T2"]}],
    ),
    "b": diagnosis(
        "effect",
        {"restitution": 0.9, "unknown": 0.1},
        ["restitution"],
        ["restitution", "rocking_damping"],
        restitution={"parameters": TOLD},
    ),
    "c": diagnosis(
        "effect",
        {"restitution": 0.6, "friction": 0.3, "unknown": 0.1},
        ["restitution"],
        ["restitution", "friction", "wear"],
        friction={"parameters": TOLD},
    ),
    "d": diagnosis("none", {"none": 0.8, "inertia": 0.1}, [], ["none"]),
    "e": diagnosis("none", {"none": 0.9}, [], ["none"]),
    "f": diagnosis(
        "effect",
        {"none": 0.2, "wear": 0.8},
        ["wear"],
        ["wear"],
        where=[{"place": "x", "axis": "order", "p_familywise": 0.04}],
    ),
    "g": diagnosis("unknown", {"unknown": 0.7, "wear": 0.2}, [], ["unknown"]),
    "h": diagnosis("unresolved", {"unknown": 0.1, "friction": 0.1}, [], ["friction"]),
    "i": diagnosis("pair", {"wear": 0.4, "friction": 0.4}, ["friction", "wear"], ["wear"]),
}


@pytest.fixture
def pack(tmp_path):
    return hand_made(tmp_path, CAMPAIGNS, VERDICTS)


@pytest.fixture(scope="module")
def scores(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scores")
    return score_pack(*hand_made(folder, CAMPAIGNS, VERDICTS), folder / "scores").scores["M", "all"]


def figure(scores, name):
    return scores[name].value, scores[name].count


def test_hits_are_counted_by_class(scores) -> None:
    assert figure(scores, "top-1 class (single)") == (0.5, 4)
    # Of d none is the most probable answer, and its class the most probable of effects.
    assert figure(scores, ANSWER) == (0.5, 4)
    assert figure(scores, FIRST) == (0.75, 4)
    assert figure(scores, "top-3 class (single)") == (1.0, 4)
    assert figure(scores, "detected (single)") == (0.75, 4)
    assert figure(scores, "false alarms (none)") == (0.5, 2)
    assert figure(scores, "unknown named (unknown)") == (0.5, 2)
    assert figure(scores, "pair found (pair)") == (1.0, 1)
    assert figure(scores, "failed or unresolved") == (1 / 9, 9)
    assert figure(scores, "where: false locations (none)") == (0.5, 2)


def test_sets_are_judged_by_class(scores) -> None:
    # a, b, c, e, g hold the truth; d, f, h do not. Sizes: 1, 2, 3, 1, 1, 1, 1, 1.
    assert figure(scores, "90 % set: coverage") == (5 / 8, 8)
    assert figure(scores, "90 % set: median size") == (1.0, 8)


def test_the_log_score_is_that_of_the_true_class(scores) -> None:
    told = [0.8, 0.9, 0.3, 0.1, 0.9, 0.2, 0.7, 0.1]
    losses = [-math.log(p) for p in told]
    assert scores["log score"].value == pytest.approx(np.mean(losses))
    # 28 effects in 24 classes, with none and unknown; g and h may not use one of them each.
    uniform = (6 * np.log(26) + 2 * np.log(25)) / 8
    assert scores["log score below uniform"].value == pytest.approx(1 - np.mean(losses) / uniform)


def test_calibration_is_of_the_first_class(scores) -> None:
    rows = [(0.8, 1), (0.9, 1), (0.6, 0), (0.8, 0), (0.9, 1), (0.8, 0), (0.7, 1), (0.1, 0)]
    # bins 0.1: |0.1 - 0|; 0.6: 0.6; 0.7: 0.3; 0.8: 3 |0.8 - 1/3|; 0.9: 2 * 0.1
    expected = (0.1 + 0.6 + 0.3 + 3 * (0.8 - 1 / 3) + 0.2) / 8
    assert calibration_error(np.array([rows], float))[0] == pytest.approx(expected)
    assert scores["calibration error"].value == pytest.approx(expected)
    true = calibration_noise([p for p, _ in rows])
    assert scores[CALIBRATION_NOISE] == true


def test_unknowns_are_best_their_probability(scores) -> None:
    # 0.7 and 0.1 against 0.05, 0.1, 0.1, 0, 0, 0, 0: 0.7 above all; 0.1 above five, level with two.
    assert scores["unknown: AUROC"].value == pytest.approx((7 + 5 + 2 * 0.5) / 14)
    assert figure(scores, "unknown: rate at 5 % false alarms") == (0.5, 2)


def test_magnitudes_closure_and_places(scores) -> None:
    # b: 0.25 and inside; c: |0.12 + 0.2| / 0.2 = 1.6 and outside
    assert figure(scores, "magnitude: median relative error") == (pytest.approx(0.925), 2)
    assert figure(scores, "magnitude: interval coverage") == (0.5, 2)
    assert figure(scores, "magnitude: estimated (single)") == (0.5, 4)
    # 0.08 / 0.16 and 0.08 / 0.2
    assert figure(scores, "magnitude: median width of interval") == (pytest.approx(0.45), 2)
    assert figure(scores, "closure over oracle: median") == (pytest.approx(0.75), 1)
    # and d, which says that there is no gap, so that there is nothing to close by the true effect
    assert figure(scores, SILENT_CLOSURE) == (pytest.approx(0.375), 2)
    assert figure(scores, "where: axis named (single)") == (0.25, 4)
    # T2 of three trials, with 3 of the weights' 4
    assert figure(scores, "where: median mass inside") == (pytest.approx(0.75), 1)
    assert figure(scores, "where: median share of trials inside") == (pytest.approx(1 / 3), 1)
    assert figure(scores, GAIN) == (pytest.approx(2.25), 1)


def test_who_names_all_trials_gains_nothing(tmp_path) -> None:
    everywhere = [{"axis": "conditions", "p_familywise": 0.0, "trials": ["T1", "T2", "T3"]}]
    verdict = diagnosis("effect", {"friction": 1.0}, ["friction"], ["friction"], where=everywhere)
    pack = hand_made(tmp_path, {"a": ("single", [effect("friction")])}, {"a": verdict})
    found = score_pack(*pack, tmp_path / "scores").scores["M", "all"]
    assert figure(found, "where: median mass inside") == (1.0, 1)
    assert figure(found, GAIN) == (1.0, 1)


def test_of_several_places_the_smallest_counts_for_the_gain(tmp_path) -> None:
    where = [
        {"axis": "conditions", "p_familywise": 0.01, "trials": trials}
        for trials in (["T1", "T2", "T3"], ["T2"], ["T2", "T3"])
    ]
    verdict = diagnosis("effect", {"friction": 1.0}, ["friction"], ["friction"], where=where)
    pack = hand_made(tmp_path, {"a": ("single", [effect("friction")])}, {"a": verdict})
    found = score_pack(*pack, tmp_path / "scores").scores["M", "all"]
    assert figure(found, "where: median mass inside") == (1.0, 1)
    assert figure(found, GAIN) == (pytest.approx(2.25), 1)


def test_who_names_no_effect_closes_nothing(tmp_path) -> None:
    # Whatever closure stands beside the verdict, and whether the true effect has one.
    kinds = {"a": "unresolved", "b": "unknown", "c": "none", "d": "effect"}
    verdicts = {
        name: diagnosis(
            kind,
            {"friction": 0.6},
            ["friction"] if kind == "effect" else [],
            closure=None if kind == "none" else 0.6,
            friction={} if kind == "none" else {"closure": 0.8},
        )
        for name, kind in kinds.items()
    }
    campaigns = {name: ("single", [effect("friction")]) for name in kinds}
    pack = hand_made(tmp_path, campaigns, verdicts)
    found = score_pack(*pack, tmp_path / "scores").scores["M", "all"]
    assert figure(found, "closure over oracle: median") == (pytest.approx(0.75), 3)
    assert figure(found, SILENT_CLOSURE) == (0.0, 4)
    cases = read_cases(pack[0], open_key(*pack[:2]), pack[2])
    assert [closure(case, silent=True) for case in cases] == [0.0, 0.0, 0.0, pytest.approx(0.75)]


def test_magnitudes_are_relative_to_the_distance_from_the_null(tmp_path) -> None:
    # 1.13 for a ratio of 1.1, which is 0.1 from 1: off by 0.3; 18 for 20 Hz, from infinity: by 0.1.
    campaigns = {
        "a": ("single", [effect("restitution", 1.1, null=1.0)]),
        "b": ("single", [effect("input_filter", 20.0, null=None)]),
    }
    verdicts = {
        name: diagnosis("effect", {e: 1.0}, [e], [e], **{e: {"parameters": {"change": estimate}}})
        for name, e, estimate in (
            ("a", "restitution", {"mean": 1.13, "ci95": [1.0, 1.2]}),
            ("b", "input_filter", {"mean": 18.0, "ci95": [15.0, 25.0]}),
        )
    }
    pack = hand_made(tmp_path, campaigns, verdicts)
    found = score_pack(*pack, tmp_path / "scores").scores["M", "all"]
    assert figure(found, "magnitude: median relative error") == (pytest.approx(0.2), 2)
    errors = [magnitude(case)[0] for case in read_cases(pack[0], open_key(*pack[:2]), pack[2])]
    assert errors == pytest.approx([0.3, 0.1])


def test_engines_mean_the_same_size_by_the_same_value() -> None:
    """An engine's way to say "none" must not shrink errors: 180 degrees of slack, or infinity."""
    study = load_study(ROOT / "configs" / "blind.yaml")
    strengths = [
        {name: drawable.strength for name, drawable in build_engine(e, study).effects.items()}
        for e in ("bullet", "mujoco")
    ]
    compared = []
    for name in sorted(set(strengths[0]) & set(strengths[1])):
        own = [of[name] for of in strengths]
        if own[0].name != own[1].name:
            continue
        value = 0.3 * own[0].low + 0.7 * own[0].high
        nulls = [one.null if math.isfinite(one.null) else None for one in own]
        sizes = [size(effect(name, value, null=null, strength=own[0].name)) for null in nulls]
        assert sizes[0] == pytest.approx(sizes[1]), name
        compared.append(name)
    assert {"catch", "outcome_rule", "restitution", "spin_friction", "table_gain"} <= set(compared)
    assert size(effect("catch", 20.0, null=180.0, strength="slack")) == 20.0
    assert size(effect("friction", 0.8, null=1.0)) == pytest.approx(0.2)


def told(low, high):
    return {"parameters": {"change": {"mean": 0.5 * (low + high), "ci95": [low, high]}}}


def test_bounds_are_where_they_are_said_to_be(tmp_path) -> None:
    """Third and fourth places, intervals that miss on either side, p values beyond 0.05."""
    names = ("friction", "restitution", "inertia", "adhesion")
    campaigns = {name: ("single", [effect("friction", 0.1)]) for name in "abcd"}
    campaigns["n"] = ("none", [])
    place = {"place": "x", "axis": "order", "p_familywise": 0.06}
    verdicts = {
        "a": diagnosis(
            "effect", dict(zip(names, (0.2, 0.4, 0.3, 0.1), strict=True)), ["restitution"],
            friction=told(0.05, 0.2),
        ),
        "b": diagnosis(
            "effect", dict(zip(names, (0.1, 0.4, 0.3, 0.2), strict=True)), ["restitution"],
            friction=told(0.2, 0.3),
        ),
        "c": diagnosis(
            "effect", dict(zip(names, (0.0, 0.4, 0.3, 0.3), strict=True)), ["restitution"],
            friction=told(0.01, 0.09),
        ),
        "d": diagnosis("effect", {"friction": 1.0}, ["friction"]),
        "n": diagnosis("none", {"none": 1.0}, where=[place]),
    }  # fmt: skip
    verdicts["a"]["gap"]["closure"] = {"value": -0.3, "ci95": [-0.5, -0.1]}
    found = score_pack(*hand_made(tmp_path, campaigns, verdicts), tmp_path / "s").scores["M", "all"]
    assert figure(found, "top-3 class (single)") == (0.5, 4)
    assert figure(found, "magnitude: interval coverage") == (pytest.approx(1 / 3), 3)
    losses = [-math.log(0.2), -math.log(0.1), -math.log(0.001), 0.0, 0.0]
    assert found["log score"].value == pytest.approx(np.mean(losses))
    assert figure(found, "closure below 0 beyond its interval") == (pytest.approx(0.25), 4)
    assert figure(found, "where: false locations (none)") == (0.0, 1)


def test_the_rate_is_found_at_one_false_alarm_in_twenty(tmp_path) -> None:
    # The second of twenty others states 0.19: 0.195 lies above it, 0.185 does not.
    stated = {f"n{i:02}": 0.01 * (i + 1) for i in range(20)} | {"u": 0.195, "v": 0.185}
    campaigns = {
        name: ("unknown", [effect("wear")]) if name in "uv" else ("none", []) for name in stated
    }
    verdicts = {
        name: diagnosis("none", {"none": 0.5, "unknown": p}, [], ["none"])
        for name, p in stated.items()
    }
    found = score_pack(*hand_made(tmp_path, campaigns, verdicts), tmp_path / "s").scores["M", "all"]
    assert figure(found, "unknown: rate at 5 % false alarms") == (0.5, 2)


def test_single_rules_of_scoring(pack) -> None:
    cases = {c.id: c for c in read_cases(pack[0], open_key(*pack[:2]), pack[2])}
    # Drift shows over the order or between sessions, nowhere else.
    drift = replace(cases["a"], where=cases["a"].where | {"axis": "order"})
    for axis, right in (("order", True), ("session", True), ("conditions", False)):
        named = (Location(axis=axis, p_familywise=0.01, trials=None),)
        assert axis_named(replace(drift, verdict=replace(drift.verdict, where=named))) is right
    # A place at p = 0.05, which 999 permutations can give, is named; magnitude 2 is 2 or more.
    for p, inside in ((0.05, 1.0), (0.051, None)):
        named = (Location(axis="conditions", p_familywise=p, trials=frozenset({"T1", "T2"})),)
        mass = where_mass(replace(cases["a"], verdict=replace(cases["a"].verdict, where=named)))
        assert (mass and mass[0]) == inside
    for relative, there in ((2.0, True), (1.999, False)):
        assert (("M", "limit x 2+") in groups([replace(cases["a"], relative=relative)])) is there
    # A class that holds just the two effects of a pair says that it is one of them.
    either = replace(cases["i"], verdict=replace(cases["i"].verdict, kind=VerdictKind.CLASS))
    assert pair_found(cases["i"])
    assert not pair_found(either)
    # There is no ratio to a true effect that closes nothing.
    for oracle, ratio in ((0.8, 0.75), (0.0, None), (-0.1, None)):
        told = replace(cases["a"].verdict, closures={"table_gain": oracle})
        assert closure(replace(cases["a"], verdict=told)) == (ratio and pytest.approx(ratio))
    # Of two effects the weaker one says how strong a pair is.
    key = open_key(*pack[:2])
    key["campaigns"]["i"]["effects"] = [effect("wear", relative=5.0), effect("friction", 0.1, 1.5)]
    found = {c.id: c for c in read_cases(pack[0], key, pack[2])}
    assert found["i"].relative == 1.5


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"tier": "T"}, r"a/M/diagnosis.json: campaign.tier is 'T', and lies in the folder of 'M'"),
        ({"name": "b"}, r"a/M/diagnosis.json: campaign.name is 'b', and lies in .* 'a'"),
    ],
)
def test_a_diagnosis_in_another_s_place_is_refused(said, message, tmp_path) -> None:
    verdicts = VERDICTS | {"a": VERDICTS["a"] | {"campaign": said}}
    pack = hand_made(tmp_path, CAMPAIGNS, verdicts)
    with pytest.raises(BlindError, match=message):
        score_pack(*pack, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()


def test_a_damaged_receipt_is_not_written_over(pack, tmp_path) -> None:
    score_pack(*pack, tmp_path / "scores")
    (pack[1] / "receipt.json").write_text("{")
    with pytest.raises(BlindError, match=r"receipt.json: cannot be read; .* get it back"):
        score_pack(*pack, tmp_path / "scores")
    assert (pack[1] / "receipt.json").read_text() == "{"


def test_groups_by_kind_and_by_engine(pack, tmp_path) -> None:
    scores = score_pack(*pack, tmp_path / "scores").scores
    assert scores["M", "kind unknown"]["90 % set: coverage"].count == 2
    assert scores["M", "kind none"]["log score"].value == pytest.approx(
        -0.5 * (math.log(0.9) + math.log(0.2))
    )
    assert scores["M", "engine mujoco, limit x 2+"]["top-1 class (single)"].count == 3


def test_names_without_meaning_gain_nothing(tmp_path) -> None:
    plain = diagnosis("effect", {"friction": 0.6, "none": 0.4}, ["friction"])
    padded = diagnosis(
        "effect", {"friction": 0.6, "none": 0.4} | {f"e{i}": 0.0 for i in range(500)}, ["friction"]
    )
    campaigns = {"a": ("single", [effect("friction")])}
    found = []
    for name, content in (("plain", plain), ("padded", padded)):
        (tmp_path / name).mkdir()
        pack = hand_made(tmp_path / name, campaigns, {"a": content})
        found.append(score_pack(*pack, tmp_path / name / "s").scores["M", "all"])
    assert found[0]["log score below uniform"].value == pytest.approx(
        found[1]["log score below uniform"].value
    )


def test_groups_by_magnitude(pack, tmp_path) -> None:
    scored = score_pack(*pack, tmp_path / "scores")
    assert scored.scores["M", "limit x 2+"]["top-1 class (single)"].count == 3
    assert scored.scores["M", "limit x 2+"]["top-1 class (single)"].value == pytest.approx(2 / 3)
    assert scored.scores["M", "limit x 0-1"]["top-1 class (single)"].value == 0
    # a, b, c, g, h and i; e and f, without effect, have no magnitude.
    for group in ("limit x 2+", "engine mujoco, limit x 2+"):
        assert scored.scores["M", group]["failed or unresolved"].count == 6
        assert "false alarms (none)" not in scored.scores["M", group]
    assert scored.scores["M", "limit x 4+"]["top-1 class (single)"].value == 1
    assert scored.scores["M", "engine mujoco"].keys() == scored.scores["M", "all"].keys()
    assert (tmp_path / "scores" / "reliability.png").stat().st_size > 1000
    table = (tmp_path / "scores" / "scores.md").read_text()
    assert "| top-1 class (single) | 0.50 [0.07, 0.93] (4) |" in table


def test_intervals_are_exact() -> None:
    # Clopper and Pearson: 0 of 10 ends at 1 - 0.025^(1/10), 10 of 10 begins at 0.025^(1/10).
    none, every, some = proportion(0, 10), proportion(10, 10), proportion(8, 10)
    assert (none.low, none.high) == (0.0, pytest.approx(1 - 0.025**0.1))
    assert (every.low, every.high) == (pytest.approx(0.025**0.1), 1.0)
    # their published table: 8 of 10 is 0.444 to 0.975
    assert (some.low, some.high) == (
        pytest.approx(0.4439, abs=1e-4),
        pytest.approx(0.9748, abs=1e-4),
    )
    assert math.isnan(proportion(0, 0).value)


def test_the_bootstrap_covers_a_mean() -> None:
    rng = np.random.default_rng(0)
    inside, widths = 0, []
    for i in range(60):
        score = resampled(rng.normal(size=60), lambda samples: samples.mean(axis=1), seed=i)
        inside += score.low <= 0 <= score.high
        widths.append(score.high - score.low)
    # binomial of 0.95: 60 draws fall below 51 in about 1 of 1000 cases
    assert inside >= 51
    # 2 * 1.96 / 60^(1/2), by 1 - 1 / (2 * 60) less; each is known to 10 %, their mean to 1.3 %
    assert np.mean(widths) == pytest.approx(0.502, rel=0.04)


def test_what_is_stated_as_certain_counts_in_the_calibration() -> None:
    samples = np.array([[[1.0, 0.0], [1.0, 1.0], [0.5, 1.0], [0.0, 0.0]]])
    # The bin at 1 is off by 0.5 in half of the campaigns, that at 0.5 by 0.5 in a quarter.
    assert calibration_error(samples)[0] == pytest.approx(0.375)


def test_true_probabilities_have_a_calibration_error_too() -> None:
    assert calibration_noise([1.0, 0.0, 1.0]) == Score(0.0, 0.0, 0.0, 3)
    # In one bin it is |k / 10 - 0.5|, k of Binomial(10, 0.5): on average 0.1230, within 2000 draws
    # of standard deviation 0.098 to 0.0022; 0.4 or more comes in 22 of 1024.
    found = calibration_noise([0.5] * 10)
    assert found.value == pytest.approx(0.1230, abs=3 * 0.0022)
    assert (found.low, found.high) == (0.0, pytest.approx(0.3))
    # In bins of their own they add up, as no bin of one campaign is ever right.
    assert calibration_noise([0.25, 0.35]).value == pytest.approx(
        (2 * 0.25 * 0.75 + 2 * 0.35 * 0.65) / 2, abs=0.02
    )
    assert np.isnan(calibration_noise([]).value)


def test_roc_area_needs_both_kinds() -> None:
    assert np.isnan(area_under_roc(np.array([[[0.3, 1.0]]])))[0]


# --- once, and only with the right key -----------------------------------------------------------


def test_diagnoses_behind_links_are_refused(pack, tmp_path) -> None:
    # They could be changed after the pack was scored, and the folder's hash be the same.
    linked = tmp_path / "linked"
    linked.mkdir()
    for path in pack[2].iterdir():
        (linked / path.name).symlink_to(path)
    with pytest.raises(BlindError, match=r"linked/.: is a link to a folder"):
        score_pack(*pack[:2], linked, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()


def test_a_pack_is_scored_once(pack, tmp_path) -> None:
    score_pack(*pack, tmp_path / "scores")
    receipt = json.loads((pack[1] / "receipt.json").read_text())
    assert receipt["scores"]
    assert "campaigns" not in receipt
    # The same diagnoses again, as after a run that was killed while it wrote its files.
    score_pack(*pack, tmp_path / "again")
    assert json.loads((pack[1] / "receipt.json").read_text()) == receipt
    assert same_folders(tmp_path / "scores", tmp_path / "again")
    changed = next(pack[2].glob("*/M/diagnosis.json"))
    changed.write_text(changed.read_text().replace("0.8", "0.9") + " ")
    with pytest.raises(BlindError, match="nowhere: no such folder"):
        score_pack(*pack[:2], tmp_path / "nowhere", tmp_path / "more")
    with pytest.raises(BlindError, match=r"with other diagnoses than .*scored once"):
        score_pack(*pack, tmp_path / "third")
    assert not (tmp_path / "third").exists()


def test_what_was_not_diagnosed_uses_no_pack_up(tmp_path) -> None:
    data, key, out = hand_made(tmp_path, CAMPAIGNS, VERDICTS, tiers=("M", "T"))
    for folder in out.glob("*/T"):
        shutil.rmtree(folder)
    with pytest.raises(BlindError, match=r"no diagnosis at tier T .*--tier"):
        score_pack(data, key, out, tmp_path / "scores")
    with pytest.raises(BlindError, match="has no tier B; it has M, T"):
        score_pack(data, key, out, tmp_path / "scores", tiers=["B"])
    assert not (key / "receipt.json").exists()
    scored = score_pack(data, key, out, tmp_path / "scores", tiers=["M"])
    assert {tier for tier, _ in scored.scores} == {"M"}


def test_an_open_pack_shows_its_campaigns_and_is_scored_again(tmp_path) -> None:
    pack = hand_made(tmp_path, CAMPAIGNS, VERDICTS, development=True)
    score_pack(*pack, tmp_path / "scores")
    score_pack(*pack, tmp_path / "again")
    content = json.loads((tmp_path / "again" / "scores.json").read_text())
    assert {c["id"] for c in content["campaigns"] if c["right"]} == {"a", "b", "e", "g", "i"}


def test_a_changed_key_is_refused(pack, tmp_path) -> None:
    path = pack[1] / "key.json"
    path.write_text(path.read_text().replace('"friction"', '"restitution"', 1))
    with pytest.raises(BlindError, match="was changed"):
        score_pack(*pack, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()


def test_changed_data_are_refused(pack, tmp_path) -> None:
    (pack[0] / "c" / "trials.csv").write_text("other")
    with pytest.raises(BlindError, match="differ from the sealed ones"):
        score_pack(*pack, tmp_path / "scores")


@pytest.mark.parametrize("changed", [["wear"], [], ["catch", "wear"]])
def test_a_changed_exclusion_is_refused(changed, pack, tmp_path) -> None:
    path = pack[0] / "pack.json"
    content = json.loads(path.read_text())
    assert content["campaigns"][6]["exclude"] == ["catch"]
    content["campaigns"][6]["exclude"] = changed
    path.write_text(json.dumps(content))
    with pytest.raises(BlindError, match="exclude of g"):
        score_pack(*pack, tmp_path / "scores")


def test_scores_that_cannot_be_written_leave_the_pack_unscored(pack, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "scores"):
        with pytest.raises(BlindError, match="no folder can be made there"):
            score_pack(*pack, out)
        assert not (pack[1] / "receipt.json").exists()
    score_pack(*pack, tmp_path / "new" / "scores")
    assert (tmp_path / "new" / "scores" / "scores.md").exists()


def test_a_missing_diagnosis_is_refused_before_the_receipt(pack, tmp_path) -> None:
    (pack[2] / "d" / "M" / "diagnosis.json").unlink()
    with pytest.raises(BlindError, match=r"diagnosis\.json: no such file"):
        score_pack(*pack, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()
    (pack[2] / "d" / "M" / "failed.json").write_text('{"error": "no motion"}')
    scores = score_pack(*pack, tmp_path / "scores").scores["M", "all"]
    assert scores["failed or unresolved"].value == pytest.approx(2 / 9)


def test_diagnoses_of_another_pack_are_refused(pack, tmp_path) -> None:
    (pack[2] / "submission.json").write_text('{"pack": "abc"}')
    with pytest.raises(BlindError, match="another pack"):
        score_pack(*pack, tmp_path / "scores")


# --- diagnosis.json -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "other"}, "schema is 'other'"),
        ({"verdict": {"kind": "maybe"}}, r"verdict\.kind is 'maybe'"),
        ({"effects": [{"name": "a", "probability": 1.5}]}, "a probability"),
        (
            {"effects": [{"name": "a", "probability": 0.7}, {"name": "b", "probability": 0.7}]},
            "sum",
        ),
        ({"effects": [{"name": "a", "probability": 0.1}] * 2}, "once"),
        ({"effects": [{"probability": 0.1}]}, r"effects\[0\]\.name"),
        ({"conformal_set_90": "a"}, "a list"),
        ({"where": [{"axis": "order"}]}, "p_familywise"),
        (
            {"effects": [{"name": "a", "probability": 0.1, "parameters": {"x": {"mean": 1}}}]},
            r"parameters\.x\.ci95",
        ),
    ],
)
def test_a_wrong_diagnosis_is_named(change, message, tmp_path) -> None:
    with pytest.raises(BlindError, match=message):
        verdict_of(VERDICTS["a"] | change, "diagnosis.json")


def test_a_bare_verdict_is_enough() -> None:
    verdict = verdict_of(
        {"schema": "vsr2.diagnosis/1", "verdict": {"kind": "none", "probability": 0.7}}, "x"
    )
    assert verdict.probabilities == {"none": 0.7}
    assert verdict.closure is None


def test_none_and_novelty_may_be_told_apart_from_the_effects() -> None:
    content = VERDICTS["b"] | {"none_probability": 0.0, "unknown": {"novelty_p": 0.25}}
    verdict = verdict_of(content, "x")
    assert verdict.probabilities["none"] == 0.0
    assert verdict.novelty == 0.75
    assert verdict_of(VERDICTS["b"], "x").novelty == 0.1


def test_broken_json_is_named(tmp_path) -> None:
    (tmp_path / "diagnosis.json").write_text("{")
    with pytest.raises(BlindError, match="is no JSON"):
        read_verdict(tmp_path)


def test_scored_packs_are_pooled(tmp_path) -> None:
    parts = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        parts.append(hand_made(tmp_path / name, CAMPAIGNS, VERDICTS))
    with pytest.raises(BlindError, match="not scored yet"):
        pool_packs(parts, tmp_path / "pooled")
    alone = [score_pack(*part, tmp_path / f"s{i}") for i, part in enumerate(parts)]
    pooled = pool_packs(parts, tmp_path / "pooled").scores["M", "all"]
    for name, score in alone[0].scores["M", "all"].items():
        assert pooled[name].count == 2 * score.count
        if name not in ("unknown: rate at 5 % false alarms", CALIBRATION_NOISE):
            assert pooled[name].value == pytest.approx(score.value), name
    assert (tmp_path / "pooled" / "scores.md").exists()
    verdict = parts[1][2] / "a" / "M" / "diagnosis.json"
    verdict.write_text(verdict.read_text().replace("0.6", "0.7"))
    with pytest.raises(BlindError, match="changed after they were scored"):
        pool_packs(parts, tmp_path / "pooled")


def test_tiers_are_scored_and_pooled_alone(tmp_path) -> None:
    part = hand_made(tmp_path, CAMPAIGNS, VERDICTS, tiers=("B", "M"))
    shutil.rmtree(part[2] / "a" / "B")
    with pytest.raises(BlindError, match=r"a/B/diagnosis.json: no such file"):
        score_pack(*part, tmp_path / "s")
    alone = score_pack(*part, tmp_path / "s", tiers=["M"])
    pooled = pool_packs([part], tmp_path / "pooled", tiers=["M"])
    assert {tier for tier, _ in pooled.scores} == {"M"}
    assert pooled.scores == alone.scores
    committed = committed_verdicts(part[0], open_key(*part[:2]), part[2], ["M"])
    assert all(set(of) == {"M"} for of in committed["verdicts"].values())


def test_an_interval_holds_its_value() -> None:
    # A calibration error of 0: resamples lie above it alone.
    rows = [(0.5, 1.0), (0.5, 0.0)] * 10
    found = resampled(rows, calibration_error)
    assert found.low == found.value == 0.0 < found.high


def test_baselines_stand_beside_the_tiers() -> None:
    def scores(value):
        own = Score(value, value, value, 10)
        return {ANSWER: own, GAIN: own, NAMED: Score(1 - value, 0.0, 1.0, 10)}

    found = {("commonest", "all"): 0.2, ("M", "all"): 0.6, ("metadata", "all"): 0.1}
    scored = Scored({key: scores(value) for key, value in found.items()}, [], [], False)
    # Over the best of them, which is the commonest answer.
    assert scored.margins(ANSWER) == {"M": pytest.approx(0.4)}
    table = format_scores(scored)
    assert "| score | M | commonest | metadata |" in table
    assert f"Above the best baseline, {ANSWER}: M +0.40." in table
    assert f"Above the best baseline, {NAMED}: M -0.50." in table
    assert f"A baseline does better in: {NAMED} (M)." in table
    # Of a calibration error the least is best: 0.1 of the worse baseline.
    low = {key: {"calibration error": Score(v, v, v, 10)} for key, v in found.items()}
    scored = Scored(low, [], [], False)
    assert scored.margins("calibration error") == {"M": pytest.approx(-0.5)}
    assert "A baseline does better in: calibration error (M)." in format_scores(scored)
    # Whoever names all trials, or random ones, gets 1.
    assert f"| {GAIN} | 0.60 [0.60, 0.60] (10) | 1.00 | 1.00 |" in table
    alone = Scored({("M", "all"): scores(0.6)}, [], [], False)
    assert alone.margins(ANSWER) == {}
    assert "Without trivial baselines" in format_scores(alone)
