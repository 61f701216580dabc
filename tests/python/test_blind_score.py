"""Scores of hand-made verdicts, computed by hand."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blind_samples import diagnosis, effect, hand_made, strength_of
from scored_campaigns import CAMPAIGNS, VERDICTS
from vsr2.analysis.intervals import (
    Score,
    area_under_roc,
    calibration_error,
    calibration_noise,
    proportion,
    resampled,
)
from vsr2.blind import score_pack
from vsr2.blind.custodian.engine import build_engine
from vsr2.blind.form.diagnosis_form import ReportedLocation
from vsr2.blind.form.seal import open_key
from vsr2.blind.scoring.cases import groups, read_cases
from vsr2.blind.scoring.score import (
    ScoreCode,
    axis_named,
    magnitude,
    right,
    size,
    where_gain,
    wrong,
)
from vsr2.blind.scoring.scored import Scored
from vsr2.config import load_study
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.report.blind_page import scores_page, write_scores
from vsr2.report.messages.scores import SCORES

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def pack(tmp_path):
    return hand_made(tmp_path, CAMPAIGNS, VERDICTS)


@pytest.fixture(scope="module")
def scores(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scores")
    return score_pack(*hand_made(folder, CAMPAIGNS, VERDICTS), folder / "scores").scores["M", "all"]


def figure(scores, code):
    return scores[code].value, scores[code].count


def test_hits_are_counted_by_class(scores) -> None:
    assert figure(scores, ScoreCode.NAMED) == (0.5, 4)
    # Of d none is the most probable answer, and its class the most probable of effects.
    assert figure(scores, ScoreCode.ANSWER) == (0.5, 4)
    assert figure(scores, ScoreCode.LEADS) == (0.75, 4)
    assert figure(scores, ScoreCode.DETECTED) == (0.75, 4)
    # c and f of a, b, c and f
    assert figure(scores, ScoreCode.WRONG) == (0.5, 4)
    assert figure(scores, ScoreCode.NONE_NAMED) == (0.5, 2)
    assert figure(scores, ScoreCode.NONE_SAID) == (0.5, 2)
    assert figure(scores, ScoreCode.UNKNOWN_SAID) == (0.5, 2)
    assert figure(scores, ScoreCode.PAIR_NAMED) == (1.0, 1)
    assert figure(scores, ScoreCode.PAIR_WRONG) == (0.0, 1)
    assert figure(scores, ScoreCode.UNRESOLVED) == (1 / 9, 9)


def test_sets_are_judged_by_class(scores) -> None:
    # a, b, c, e, g hold the truth; d, f, h do not. Sizes: 1, 2, 3, 1, 1, 1, 1, 1.
    assert figure(scores, ScoreCode.SET_COVERAGE) == (5 / 8, 8)
    assert figure(scores, ScoreCode.SET_SIZE) == (1.0, 8)


def test_the_log_score_is_that_of_the_true_class(scores) -> None:
    reported = [0.8, 0.9, 0.3, 0.1, 0.9, 0.2, 0.7, 0.1]
    losses = [-math.log(p) for p in reported]
    assert scores[ScoreCode.LOG_SCORE].value == pytest.approx(np.mean(losses))


def test_calibration_is_of_the_first_class(scores) -> None:
    rows = [(0.8, 1), (0.9, 1), (0.6, 0), (0.8, 0), (0.9, 1), (0.8, 0), (0.7, 1), (0.1, 0)]
    # bins 0.1: |0.1 - 0|; 0.6: 0.6; 0.7: 0.3; 0.8: 3 |0.8 - 1/3|; 0.9: 2 * 0.1
    expected = (0.1 + 0.6 + 0.3 + 3 * (0.8 - 1 / 3) + 0.2) / 8
    assert calibration_error(np.array([rows], float))[0] == pytest.approx(expected)
    assert scores[ScoreCode.CALIBRATION].value == pytest.approx(expected)
    true = calibration_noise([p for p, _ in rows])
    assert scores[ScoreCode.CALIBRATION_NOISE] == true


def test_unknowns_are_best_their_probability(scores) -> None:
    # 0.7 and 0.1 against 0.05, 0.1, 0.1, 0, 0, 0, 0: 0.7 above all; 0.1 above five, level with two.
    assert scores[ScoreCode.UNKNOWN_AUROC].value == pytest.approx((7 + 5 + 2 * 0.5) / 14)
    assert figure(scores, ScoreCode.UNKNOWN_RATE) == (0.5, 2)


def test_magnitudes_closure_and_locations(scores) -> None:
    # b: 0.25 and inside; c: |0.12 + 0.2| / 0.2 = 1.6 and outside
    assert figure(scores, ScoreCode.ERROR) == (pytest.approx(0.925), 2)
    assert figure(scores, ScoreCode.INTERVAL) == (0.5, 2)
    assert figure(scores, ScoreCode.ESTIMATED) == (0.5, 4)
    # a and d state a closure and the interval of a gain, a alone a headline.
    assert figure(scores, ScoreCode.CLOSURE) == (pytest.approx(0.2), 2)
    assert figure(scores, ScoreCode.HEADLINE) == (0.4, 1)
    assert figure(scores, ScoreCode.LOSS_FALLS) == (0.5, 2)
    assert figure(scores, ScoreCode.LOSS_RISES) == (0.5, 2)
    # T2 of three trials, with 3 of the weights' 4
    assert figure(scores, ScoreCode.WHERE_GAIN) == (pytest.approx(2.25), 1)
    assert figure(scores, ScoreCode.WHERE_TWICE) == (1.0, 1)
    assert figure(scores, ScoreCode.WHERE_AXIS) == (0.25, 4)
    # f alone: that of e is significant, and does not stand out.
    assert figure(scores, ScoreCode.WHERE_FALSE) == (0.5, 2)


@pytest.mark.parametrize(
    ("locations", "gain"),
    [
        # All trials gain nothing; of several locations the median counts.
        ([["T1", "T2", "T3"]], 1.0),
        ([["T1", "T2", "T3"], ["T2"], ["T2", "T3"]], 1.125),
        ([None], None),
        ([], None),
    ],
)
def test_what_locations_hold(locations, gain, tmp_path) -> None:
    where = [{"axis": "order", "p_familywise": 0.01, "trials": trials} for trials in locations]
    verdict = diagnosis("effect", {"friction": 1.0}, ["friction"], ["friction"], where=where)
    pack = hand_made(tmp_path, {"a": ("single", [effect("friction")])}, {"a": verdict})
    (case,) = read_cases(pack[0], open_key(*pack[:2]), pack[2])
    assert where_gain(case) == (gain and pytest.approx(gain))
    unknown = replace(case, where=case.where | {"weights": []})
    assert where_gain(unknown) is None


def test_magnitudes_are_relative_to_the_distance_from_the_null(tmp_path) -> None:
    # 1.13 for a ratio of 1.1, which is 0.1 from 1: off by 0.3; 18 for 20 Hz, from infinity: by 0.1.
    campaigns = {
        "a": ("single", [effect("restitution", 1.1, null=1.0)]),
        "b": ("single", [effect("input_filter", 20.0, null=None)]),
    }
    verdicts = {
        name: diagnosis(
            "effect", {e: 1.0}, [e], [e], **{e: {"parameters": {strength_of(e): estimate}}}
        )
        for name, e, estimate in (
            ("a", "restitution", {"mean": 1.13, "ci90": [1.0, 1.2]}),
            ("b", "input_filter", {"mean": 18.0}),
        )
    }
    pack = hand_made(tmp_path, campaigns, verdicts)
    found = score_pack(*pack, tmp_path / "scores").scores["M", "all"]
    assert figure(found, ScoreCode.ERROR) == (pytest.approx(0.2), 2)
    # The other states no interval.
    assert figure(found, ScoreCode.INTERVAL) == (1.0, 1)
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


def reported(low, high):
    return {"parameters": {"factor": {"mean": 0.5 * (low + high), "ci90": [low, high]}}}


def test_bounds_are_where_they_are_said_to_be(tmp_path) -> None:
    """Intervals that miss on either side, and probabilities below the least that counts."""
    campaigns = {name: ("single", [effect("friction", 0.1)]) for name in "abcd"}
    verdicts = {
        "a": diagnosis("effect", {"friction": 0.2}, ["friction"], friction=reported(0.05, 0.2)),
        "b": diagnosis("effect", {"friction": 0.1}, ["friction"], friction=reported(0.2, 0.3)),
        "c": diagnosis("effect", {"friction": 0.0}, ["friction"], friction=reported(0.01, 0.09)),
        "d": diagnosis("effect", {"friction": 1.0}, ["friction"]),
    }
    found = score_pack(*hand_made(tmp_path, campaigns, verdicts), tmp_path / "s").scores["M", "all"]
    assert figure(found, ScoreCode.INTERVAL) == (pytest.approx(1 / 3), 3)
    losses = [-math.log(0.2), -math.log(0.1), -math.log(0.001), 0.0]
    assert found[ScoreCode.LOG_SCORE].value == pytest.approx(np.mean(losses))


@pytest.mark.parametrize(
    ("truth", "kind", "names", "is_right", "is_wrong"),
    [
        (["wear"], "effect", ["wear"], True, False),
        (["wear"], "effect", ["friction"], False, True),
        (["wear"], "class", ["friction", "inertia", "wear"], True, False),
        # Four classes are too many, but not wrong; members of one class count once.
        (["wear"], "class", ["friction", "inertia", "catch", "wear"], False, False),
        (["wear"], "class", ["friction", "inertia", "change_point", "wear"], True, False),
        (["wear"], "class", ["friction", "inertia"], False, True),
        (["wear"], "pair", ["wear", "friction"], False, True),
        (["wear", "friction"], "pair", ["friction", "wear"], True, False),
        (["wear", "friction"], "pair", ["friction", "inertia"], False, True),
        (["wear", "friction"], "effect", ["friction"], False, False),
        (["wear", "friction"], "class", ["friction", "wear"], False, False),
        ([], "effect", ["friction"], False, True),
        # No name of an answer makes a name right.
        ([], "class", ["friction", "none"], False, True),
        ([], "none", [], True, None),
        ([], "unresolved", [], False, None),
        (["wear"], "none", [], False, None),
        (["wear"], "unresolved", ["wear"], False, None),
    ],
)
def test_what_is_right_and_what_is_wrong(pack, truth, kind, names, is_right, is_wrong) -> None:
    case = next(c for c in read_cases(pack[0], open_key(*pack[:2]), pack[2]) if c.id == "a")
    verdict = replace(case.verdict, kind=VerdictKind(kind), effects=tuple(names))
    asked = replace(case, truth=tuple(case.labels(truth or ["none"])), verdict=verdict)
    assert right(asked) is is_right
    assert wrong(asked) is is_wrong


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
    assert figure(found, ScoreCode.UNKNOWN_RATE) == (0.5, 2)


def test_single_rules_of_scoring(pack) -> None:
    cases = {c.id: c for c in read_cases(pack[0], open_key(*pack[:2]), pack[2])}
    # Drift shows over the order or between sessions, nowhere else.
    drift = replace(cases["a"], where=cases["a"].where | {"axis": "order"})
    for axis, found in (("order", True), ("session", True), ("conditions", False)):
        named = (ReportedLocation(axis=axis, trials=frozenset({"T1"})),)
        assert axis_named(replace(drift, verdict=replace(drift.verdict, where=named))) is found
    # Magnitude 2 is 2 or more.
    for relative, spans in ((2.0, ["2-4", "1+", "2+"]), (1.999, ["1-2", "1+"]), (0.5, ["0-1"])):
        own = [name for _, name in groups([replace(cases["a"], relative=relative)])]
        assert own[3:] == [f"engine mujoco, limits {span}" for span in spans]
    # Of two effects the weaker one says how strong a pair is.
    key = open_key(*pack[:2])
    key["campaigns"]["i"]["effects"] = [effect("wear", relative=5.0), effect("friction", 0.1, 1.5)]
    found = {c.id: c for c in read_cases(pack[0], key, pack[2])}
    assert found["i"].relative == 1.5


def test_groups_by_kind_and_by_engine(pack, tmp_path) -> None:
    scores = score_pack(*pack, tmp_path / "scores").scores
    assert scores["M", "kind unknown"][ScoreCode.SET_COVERAGE].count == 2
    assert scores["M", "kind none"][ScoreCode.LOG_SCORE].value == pytest.approx(
        -0.5 * (math.log(0.9) + math.log(0.2))
    )
    assert scores["M", "engine mujoco, limits 2+"][ScoreCode.NAMED].count == 3


def test_groups_by_magnitude(pack, tmp_path) -> None:
    scored = score_pack(*pack, tmp_path / "scores")

    def of(span):
        return scored.scores["M", f"engine mujoco, limits {span}"]

    assert figure(of("2+"), ScoreCode.NAMED) == (pytest.approx(2 / 3), 3)
    assert of("0-1")[ScoreCode.NAMED].value == 0
    assert of("4+")[ScoreCode.NAMED].value == 1
    # a, b, c, g, h and i; e and f, without effect, have no magnitude.
    assert of("2+")[ScoreCode.UNRESOLVED].count == 6
    assert ScoreCode.NONE_NAMED not in of("2+")
    assert scored.scores["M", "engine mujoco"].keys() == scored.scores["M", "all"].keys()
    write_scores(scored, tmp_path / "scores")
    assert (tmp_path / "scores" / "reliability.png").stat().st_size > 1000
    table = (tmp_path / "scores" / "scores.md").read_text()
    assert "| named rightly, in at most 3 classes (single) | 0.50 [0.07, 0.93] (4) |" in table


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


def test_a_weight_counts_a_campaign_as_often_as_it_says() -> None:
    rows = np.random.default_rng(0).random((1, 12, 2)).round(1)
    times = np.arange(1, 13) % 4
    repeated = calibration_error(np.repeat(rows, times, axis=1))
    assert calibration_error(rows, times) == pytest.approx(repeated)


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


def test_an_interval_holds_its_value() -> None:
    # A calibration error of 0: resamples lie above it alone.
    rows = [(0.5, 1.0), (0.5, 0.0)] * 10
    found = resampled(rows, calibration_error)
    assert found.low == found.value == 0.0 < found.high


def test_baselines_stand_beside_the_tiers() -> None:
    def scores(value):
        own = Score(value, value, value, 10)
        named = Score(1 - value, 0.0, 1.0, 10)
        return {ScoreCode.ANSWER: own, ScoreCode.WHERE_GAIN: own, ScoreCode.NAMED: named}

    found = {("commonest", "all"): 0.2, ("M", "all"): 0.6, ("metadata", "all"): 0.1}
    scored = Scored({key: scores(value) for key, value in found.items()}, [], [], False)
    # Over the best of them, which is the commonest answer.
    assert scored.margins(ScoreCode.ANSWER) == {"M": pytest.approx(0.4)}
    table = scores_page(scored)
    assert "| score | M | commonest | metadata |" in table
    answer, named = (SCORES[code] for code in (ScoreCode.ANSWER, ScoreCode.NAMED))
    assert f"Above the best baseline, {answer}: M +0.40." in table
    assert f"Above the best baseline, {named}: M -0.50." in table
    assert f"A baseline does better in: {named} (M)." in table
    # Of a calibration error the least is best: 0.1 of the worse baseline.
    low = {key: {ScoreCode.CALIBRATION: Score(v, v, v, 10)} for key, v in found.items()}
    scored = Scored(low, [], [], False)
    assert scored.margins(ScoreCode.CALIBRATION) == {"M": pytest.approx(-0.5)}
    assert "A baseline does better in: calibration error (M)." in scores_page(scored)
    # Whoever names all trials, or random ones, gets 1.
    assert f"| {SCORES[ScoreCode.WHERE_GAIN]} | 0.60 [0.60, 0.60] (10) | 1.00 | 1.00 |" in table
    alone = Scored({("M", "all"): scores(0.6)}, [], [], False)
    assert alone.margins(ScoreCode.ANSWER) == {}
    assert "Without trivial baselines" in scores_page(alone)


def test_every_score_has_words() -> None:
    assert list(SCORES) == list(ScoreCode)
    assert len(set(SCORES.values())) == len(SCORES)
