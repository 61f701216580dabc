"""Figures of calibration and power: every campaign of the drawn rounds counts once a tier."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from figure_diagnosis import (
    EDGES,
    ENGINES,
    FIRST_ROUND,
    QUESTIONS,
    calibration,
    cases_of,
    committed_rounds,
    draw,
    power,
    stated,
)
from vsr2.analysis.intervals import INTERVALS, calibration_error, proportion
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.scoring.cases import engine_group
from vsr2.blind.scoring.score import ScoreCode, score_cases
from vsr2.campaign import TIERS


@pytest.fixture(scope="module")
def cases():
    return cases_of(committed_rounds())


def test_all_rounds_from_the_first_are_drawn():
    drawn = [int(path.name.rsplit("_", 1)[1]) for path in committed_rounds()]
    assert drawn == sorted(drawn)
    assert drawn[0] == FIRST_ROUND
    # Rounds are numbered without a gap, those of the other engine's check among them.
    assert drawn == list(range(FIRST_ROUND, drawn[-1] + 1))


def test_every_campaign_counts_once_in_the_calibration(cases):
    asked = Counter((case.engine, case.tier) for case in cases)
    points = calibration(cases)
    assert {where: sum(p.score.count for p in own) for where, own in points.items()} == asked
    for own in points.values():
        for one in own:
            assert one.group / INTERVALS.bins <= one.at <= (one.group + 1) / INTERVALS.bins
            assert one.score == proportion(
                round(one.score.value * one.score.count), one.score.count
            )


def test_gaps_to_the_diagonal_add_up_to_the_calibration_error(cases):
    for (engine, tier), own in calibration(cases).items():
        asked = [case for case in cases if (case.engine, case.tier) == (engine, tier)]
        rows = [[stated(case), case.first[0] in case.truth] for case in asked]
        gaps = sum(p.score.count * abs(p.at - p.score.value) for p in own) / len(asked)
        assert gaps == pytest.approx(calibration_error(np.array([rows], dtype=float))[0])


def test_every_single_effect_counts_once_in_the_power(cases):
    singles = Counter((c.engine, c.tier) for c in cases if c.kind == Kind.SINGLE)
    for question in QUESTIONS.values():
        points = power(cases, question)
        assert {where: sum(p.score.count for p in own) for where, own in points.items()} == singles
        for (engine, _), own in points.items():
            ends = list(pairwise(EDGES[engine]))
            assert all(ends[p.group][0] <= p.at < ends[p.group][1] for p in own)


def test_strong_effects_are_scored_as_the_blind_check_scores_them(cases):
    groups = {engine: engine_group(engine, 2.0) for engine in ENGINES}
    scores = score_cases([c for c in cases if c.kind == Kind.SINGLE], set(groups.values()))
    codes = (ScoreCode.LEADS, ScoreCode.NAMED)
    for code, question in zip(codes, QUESTIONS.values(), strict=True):
        points = power(cases, question)
        for engine, group in groups.items():
            for tier in TIERS:
                strong = [p.score for p in points[engine, tier] if EDGES[engine][p.group] >= 2]
                wanted = scores[tier, group][code]
                assert sum(one.count for one in strong) == wanted.count
                hits = sum(one.value * one.count for one in strong)
                assert hits == pytest.approx(wanted.value * wanted.count)


def test_both_figures_are_written(cases, tmp_path, capsys):
    written = draw(cases, tmp_path)
    assert [path.name for path in written] == ["diagnosis_calibration.png", "diagnosis_power.png"]
    assert all(path.stat().st_size > 10_000 for path in written)
    assert capsys.readouterr().out.count("\n") == 3 * len(ENGINES) * len(TIERS)
