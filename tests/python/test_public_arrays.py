"""Public functions that take arrays of numbers drop no mask, imaginary part or text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vsr2.analysis.baseline import logistic_probability
from vsr2.analysis.bootstrap import classification_intervals
from vsr2.analysis.intervals import calibration_noise, resampled
from vsr2.analysis.metrics import classification_metrics
from vsr2.analysis.overturning_margin import (
    MarginModel,
    fit_margin_model,
    out_of_fold_probability,
)
from vsr2.analysis.probability import (
    overturning_probability,
    probability_error,
    probability_intervals,
    reliability,
)
from vsr2.analysis.ranks import rank, uniformity
from vsr2.campaign import Series
from vsr2.campaign.folds import grouped_folds, motion_resamples
from vsr2.config.problems import shown
from vsr2.errors import Vsr2Error
from vsr2.fragility.fit import fit_fragility
from vsr2.hazard import HazardCurve, excluded_age, overturning_rate, survival
from vsr2.motion import rotd
from vsr2.scene.mass import principal_mass_properties

CURVE = HazardCurve("pga_g", np.array([0.1, 0.2, 0.4]), np.array([1e-2, 1e-3, 1e-4]))
FELL = np.array([True, False, True, False])
FOUR = np.array([0.1, 0.2, 0.3, 0.4])

TAKERS: dict[str, Callable[[Any], object]] = {
    "median": lambda a: overturning_rate(CURVE, a, 0.3),
    "beta": lambda a: overturning_rate(CURVE, 0.3, a),
    "survival": lambda a: survival(a, 1000.0),
    "rates": excluded_age,
    "levels": lambda a: HazardCurve("pga_g", a, np.array([4e-2, 1e-2, 1e-3, 1e-4])),
    "intensities": lambda a: fit_fragility(a, FELL, list("aabb")),
    "rotd": lambda a: rotd(FOUR, a),
    "series": lambda a: Series(time=a, tilt=np.zeros(4)),
    "mass centre": lambda a: principal_mass_properties(1.0, a[:3], np.eye(3), "rock"),
    "tensor": lambda a: principal_mass_properties(1.0, np.zeros(3), a, "rock"),
    "folds": lambda a: grouped_folds(np.arange(4), a, 2),
    "mean margin": MarginModel().mean,
    "margins": lambda a: fit_margin_model(a, FELL),
    "ended": lambda a: fit_margin_model(FOUR[None], a),
    "replicates": overturning_probability,
    "error": probability_error,
    "probability": lambda a: probability_intervals(FELL, a, np.arange(4).astype(str)),
    "pga": lambda a: logistic_probability(a, FOUR, FELL, FOUR, FOUR),
    "resampled": lambda a: resampled(a, lambda rows: rows.mean(axis=1)),
    "stated": calibration_noise,
    "rank": lambda a: rank(a, 0.2, np.random.default_rng(0)),
    "ranks": uniformity,
}
TRUTH_TAKERS: dict[str, Callable[[Any], object]] = {
    "observed": lambda a: classification_metrics(a, FELL),
    "predicted": lambda a: classification_metrics(FELL, a),
    "intervals": lambda a: classification_intervals(a, FELL, list("aabb")),
    "probability": lambda a: probability_intervals(a, FOUR, list("aabb")),
    "reliability": lambda a: reliability(a, FOUR, list("aabb")),
    "fragility": lambda a: fit_fragility(FOUR, a, list("aabb")),
    "logistic": lambda a: logistic_probability(FOUR, FOUR, a, FOUR, FOUR),
}
SPOILT_TRUTH: dict[str, Any] = {
    "masked": np.ma.array(FELL, mask=[0, 1, 0, 0]),
    "masked in a list": [True, np.ma.masked, True, False],
    "missing": [1.0, np.nan, 1.0, 0.0],
    "text": ["overturned", "stable", "overturned", "stable"],
}
LABEL_TAKERS: dict[str, Callable[[Any], object]] = {
    "intervals": lambda a: classification_intervals(FELL, FELL, a),
    "probability": lambda a: probability_intervals(FELL, FOUR, a),
    "fragility": lambda a: fit_fragility(FOUR, FELL, a),
    "folds": lambda a: grouped_folds(a, FELL, 2),
    "resamples": lambda a: motion_resamples(a, 10),
    "margins": lambda a: fit_margin_model(FOUR[None].repeat(2, 0), FELL, a),
    "out of fold": lambda a: out_of_fold_probability(FOUR[None], FELL, a, 2),
}
SPOILT_LABELS: dict[str, Any] = {
    "masked": np.ma.array(list("abab"), mask=[0, 1, 0, 0]),
    "masked in a list": ["a", np.ma.masked, "a", "b"],
    "missing": np.array(["a", None, "b", "b"], dtype=object),
    "nan": [1.0, np.nan, 2.0, 2.0],
    "pairs": [["a", "b"], ["a", "b"]],
}
SPOILT: dict[str, Any] = {
    "masked": np.ma.array(FOUR, mask=[0, 1, 0, 0]),
    "masked in a list": [0.1, np.ma.masked, 0.3, 0.4],
    "complex": FOUR + 1j,
    "text": ["0.1", "0.2", "0.3", "0.4"],
    "dates": np.array(["2020", "2021", "2022", "2023"], "datetime64[Y]"),
}


REFUSED = (
    (TAKERS, SPOILT, r"masked array|not an array of numbers"),
    (TRUTH_TAKERS, SPOILT_TRUTH, r"masked array|must be boolean"),
    (LABEL_TAKERS, SPOILT_LABELS, r"masked array|must be (text|of shape)"),
)
"""What takes numbers, truths or labels, what none of them is, and how that is refused."""


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("take", "spoilt", "said"),
    [
        pytest.param(take, value, said, id=f"{name}-{kind}")
        for takers, spoilt, said in REFUSED
        for name, take in takers.items()
        for kind, value in spoilt.items()
    ],
)
def test_masks_and_values_of_another_kind_are_refused(
    take: Callable[[Any], Any], spoilt: Any, said: str
) -> None:
    with pytest.raises(Vsr2Error, match=said):
        take(spoilt)


@pytest.mark.parametrize("labels", [list("aabb"), [1, 1, 2, 2], np.array(list("aabb"), object)])
def test_labels_may_be_text_or_numbers(labels: Any) -> None:
    assert len(set(grouped_folds(labels, FELL, 2).tolist())) == 2
    with pytest.raises(Vsr2Error, match="3 outcomes of 4 trials"):
        grouped_folds(labels, FELL[:3], 2)


@pytest.mark.parametrize("taker", [overturning_probability, probability_error])
def test_outcomes_may_be_truth_values(taker: Callable[[Any], Any]) -> None:
    assert np.array_equal(taker([FELL]), taker([FELL.astype(float)]))
    assert np.array_equal(taker([[True, False]]), taker([[1, 0]]))


def test_a_value_is_shown_in_one_line() -> None:
    assert shown(np.zeros((2, 2))) == "array([[0., 0.], [0., 0.]])"
