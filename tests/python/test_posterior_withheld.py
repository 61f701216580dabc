"""Parts of the library that are withheld from a training, and how many effects may act together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from diagnosis_samples import NAMES, linear, linear_rehearsal, quick_training
from vsr2.errors import DiagnosisError
from vsr2.posterior import training
from vsr2.posterior.training import train
from vsr2.posterior.withheld_parts import parts_of, withheld


@pytest.fixture(scope="module")
def rehearsal():
    with quick_training():
        yield linear_rehearsal(300)


def given_to_withheld(rehearsal, monkeypatch) -> tuple[Any, ...]:
    """What a training gives to :func:`withheld`."""
    given: list[tuple[Any, ...]] = []

    def noting(*arguments):
        given.append(arguments)
        return withheld(*arguments)

    monkeypatch.setattr(training, "withheld", noting)
    rehearsal.posterior("M", 200)
    return given[0]


def test_nothing_is_learned_from_campaigns_of_a_part_that_is_withheld(
    rehearsal, monkeypatch
) -> None:
    residuals, *rest = given_to_withheld(rehearsal, monkeypatch)
    truth = rest[2]
    first = next(iter(parts_of(truth.alike)))
    acts = truth.acting[:, list(first.effects)].any(axis=1)
    rng = np.random.default_rng(0)
    changed = [np.array(one) for one in residuals]
    for one in changed:
        one[acts] = rng.standard_normal((acts.sum(), one.shape[1]))
    before, after = (withheld(one, *rest)[0] for one in (residuals, changed))
    np.testing.assert_array_equal(before.known, after.known)
    for one, other in zip(before.within.curves, after.within.curves, strict=True):
        np.testing.assert_array_equal(one.means, other.means)
    for one, other in zip(
        before.within.networks[0].weights, after.within.networks[0].weights, strict=True
    ):
        np.testing.assert_array_equal(one, other)
    assert acts[before.rows].all()
    assert np.abs(before.left - after.left).max() > 0.1
    assert set(before.within.sets.names).isdisjoint(truth.sets.names[k] for k in first.effects)


@pytest.mark.parametrize("most", [1, 3])
def test_as_many_effects_are_fitted_as_may_act(rehearsal, most: int) -> None:
    few = [k for k, acting in enumerate(rehearsal.campaigns.sets) if len(acting) <= most][:200]
    campaigns = rehearsal.campaigns.chosen(np.array(few))
    library = linear().library
    found = train(rehearsal.at("M"), campaigns, library, rehearsal.trials, most=most)
    assert found.outside.coefficients.size == most + 1
    assert bool(found.within.judges) == (most > 1)
    scatter = found.standard.scatter
    one = found.infer(np.zeros(len(scatter)), found.standard.centre + scatter)
    assert one.probability.sum() == pytest.approx(1)


def test_campaigns_of_what_the_library_lacks_have_no_part_in_it(rehearsal) -> None:
    known = rehearsal.campaigns
    left = {name: one for name, one in linear().library.items() if name != NAMES[0]}
    assert {one.name for acting in known.within(left).sets for one in acting} == set(left)
    assert known.within(linear().library) is known
    found = train(rehearsal.at("M"), known, left, rehearsal.trials)
    assert found.sets.names == tuple(left)
    assert (found.campaigns, found.trained_on) == (len(known), len(known.within(left)))
    assert found.trained_on < found.campaigns


def test_a_library_without_effects_is_refused(rehearsal) -> None:
    with pytest.raises(DiagnosisError, match="no effect is left to look for"):
        train(rehearsal.at("M"), rehearsal.campaigns, {}, rehearsal.trials)
