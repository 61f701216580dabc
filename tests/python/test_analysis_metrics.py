"""Agreement figures: definitions, rules for empty counts, and the supplement's Table S2."""

from __future__ import annotations

import csv
import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsr2.analysis import Classification, classification_metrics
from vsr2.errors import ResultError

SEED = Path(
    os.environ.get("VSR2_SEED_DATA", Path(__file__).resolve().parents[3] / "shared" / "seed")
)
TABLE_S2 = SEED / "table_s2.csv"
TRIALS = 582
OVERTURNED = 243
PRINTED = 0.0005 + 1e-9
"""Half a unit of the third decimal."""
FIGURES = ("accuracy", "precision", "recall", "f1", "objective")


def outcomes(counts: Classification) -> tuple[np.ndarray, np.ndarray]:
    """Observed and predicted outcomes with these counts."""
    numbers = (
        counts.true_positives,
        counts.false_positives,
        counts.false_negatives,
        counts.true_negatives,
    )
    observed = np.repeat([True, False, True, False], numbers)
    predicted = np.repeat([True, True, False, False], numbers)
    return observed, predicted


def rows_of_table_s2() -> list[dict[str, str]]:
    if not TABLE_S2.is_file():
        pytest.skip(f"{TABLE_S2} does not exist; set VSR2_SEED_DATA to the supplement's folder")
    with open(TABLE_S2, encoding="utf-8") as file:
        return list(csv.DictReader(file))


def counts_that_print(row: dict[str, str], trials: int = TRIALS) -> list[Classification]:
    """All counts over the campaign's trials whose figures round to the printed ones."""
    found = []
    for tp in range(OVERTURNED + 1):
        if abs(tp / OVERTURNED - float(row["recall"])) > PRINTED:
            continue
        for fp in range(trials - OVERTURNED + 1):
            counts = Classification(tp, fp, OVERTURNED - tp, trials - OVERTURNED - fp)
            if all(abs(getattr(counts, key) - float(row[key])) <= PRINTED for key in FIGURES):
                found.append(counts)
    return found


def test_table_s2_is_of_integer_counts() -> None:
    rows = rows_of_table_s2()
    assert len(rows) == 147
    odd = []
    for row in rows:
        found = counts_that_print(row)
        # Accuracy and recall to three decimals leave one pair of counts out of 582.
        if len(found) != 1:
            odd.append(row)
            continue
        assert classification_metrics(*outcomes(found[0])) == found[0]
    # One row fits no counts over 582 trials: the nearest have an accuracy of 0.87457, not 0.874.
    # Over 581, one trial that did not overturn missing, it fits.
    [row] = odd
    assert [row[key] for key in FIGURES] == ["0.874", "0.909", "0.778", "0.838", "0.854"]
    assert counts_that_print(row, TRIALS - 1) == [Classification(189, 19, 54, 319)]


def test_table_s2_extremes() -> None:
    rows = rows_of_table_s2()
    best = max(rows, key=lambda row: float(row["objective"]))
    assert counts_that_print(best)[0].true_positives == 206
    # No false alarm at all in one row; in others everything but one trial is predicted to overturn.
    [timid] = [row for row in rows if float(row["precision"]) == 1]
    assert counts_that_print(timid)[0].false_positives == 0
    bold = [row for row in rows if float(row["recall"]) == 1]
    assert {counts_that_print(row)[0] for row in bold} == {Classification(243, 338, 0, 1)}


def test_definitions() -> None:
    observed = np.array([1, 1, 1, 0, 0, 0, 0, 0], dtype=bool)
    predicted = np.array([1, 1, 0, 1, 0, 0, 0, 0], dtype=bool)
    got = classification_metrics(observed, predicted)
    assert got == Classification(2, 1, 1, 4)
    assert got.trials == 8
    assert got.accuracy == 6 / 8
    assert got.precision == 2 / 3
    assert got.recall == 2 / 3
    assert got.f1 == pytest.approx(2 / 3)
    assert got.objective == pytest.approx((6 / 8 + 2 / 3 + 2 / 3) / 3)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1))
def test_properties(pairs: list[tuple[bool, bool]]) -> None:
    observed, predicted = np.array(pairs, dtype=bool).T
    got = classification_metrics(observed, predicted)
    assert got.trials == len(pairs)
    assert got.accuracy == np.mean(observed == predicted)
    # Observed and predicted exchanged: precision and recall change places.
    mirrored = classification_metrics(predicted, observed)
    np.testing.assert_equal(mirrored.precision, got.recall)
    np.testing.assert_equal(mirrored.f1, got.f1)
    if got.true_positives:
        harmonic = 2 / (1 / got.precision + 1 / got.recall)
        assert got.f1 == pytest.approx(harmonic)


def test_empty_denominators_are_unknown() -> None:
    def figures(observed: list[bool], predicted: list[bool]) -> list[float]:
        got = classification_metrics(
            np.array(observed, dtype=bool), np.array(predicted, dtype=bool)
        )
        return [getattr(got, key) for key in FIGURES]

    nan = math.nan
    np.testing.assert_equal(figures([], []), [nan, nan, nan, nan, nan])
    np.testing.assert_equal(figures([False], [False]), [1, nan, nan, nan, nan])
    np.testing.assert_equal(figures([True], [False]), [0, nan, 0, 0, nan])
    np.testing.assert_equal(figures([False], [True]), [0, 0, nan, 0, nan])


def test_what_is_not_boolean_is_refused() -> None:
    good = np.array([True, False])
    with pytest.raises(ResultError, match=r"predicted: must be boolean.*float64"):
        classification_metrics(good, np.array([1.0, np.nan]))
    with pytest.raises(ResultError, match=r"observed: must be boolean .*shape \(1, 2\)"):
        classification_metrics(good[None], good)
    with pytest.raises(ResultError, match="observed has 2 trials, predicted 1"):
        classification_metrics(good, good[:1])
