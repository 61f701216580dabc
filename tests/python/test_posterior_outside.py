"""A cause outside the library: what is withheld, what is left over, and what follows."""

from __future__ import annotations

import numpy as np
import pytest

from vsr2.effects import library
from vsr2.posterior.effect_curves import Curves
from vsr2.posterior.outside import OUTSIDE, Outside, left_over
from vsr2.posterior.sets import declared_alike
from vsr2.posterior.truth import PRIOR
from vsr2.posterior.withheld_parts import WITHHELD, parts_of


@pytest.mark.parametrize("count", [2, 5, 12, 32])
def test_each_effect_is_withheld_once_with_all_that_is_alike(count: int) -> None:
    rng = np.random.default_rng(count)
    alike = np.triu(rng.random((count, count)) < 1 / count, 1)
    alike |= alike.T
    parts = list(parts_of(alike))
    largest = 1 + alike.sum(axis=1).max()
    unknown = [effect for part in parts for effect in part.unknown]
    for part in parts:
        own = set(part.effects)
        assert len(own) < count
        assert len(own) <= max(np.ceil(WITHHELD.share * count), largest)
        for effect in part.effects:
            alone = set(np.flatnonzero(alike[effect])) <= own
            assert (effect in part.unknown) == alone
    assert set(unknown) == {k for k in range(count) if alike[k].sum() < count - 1}


def test_what_is_alike_to_all_others_keeps_none_of_them_from_being_withheld() -> None:
    star = np.zeros((4, 4), dtype=bool)
    star[0, 1:] = star[1:, 0] = True
    assert {effect for part in parts_of(star) for effect in part.unknown} == {1, 2, 3}


def test_nothing_is_withheld_where_nothing_would_be_left() -> None:
    assert not list(parts_of(np.zeros((0, 0), dtype=bool)))
    assert not list(parts_of(np.zeros((1, 1), dtype=bool)))
    assert not list(parts_of(np.ones((3, 3), dtype=bool)))


def test_the_library_s_effects_are_all_withheld_in_few_parts() -> None:
    alike = declared_alike(library())
    parts = list(parts_of(alike))
    assert len(parts) <= 9
    assert {effect for part in parts for effect in part.unknown} == set(range(len(alike)))


STEPS = np.linspace(0.5, 4.0, 8)


def three_curves(freedom: int = 5) -> Curves:
    """Effects that act along the first three axes, by 0.5 to 4."""
    means = STEPS[:, None] * np.eye(3, freedom)[:, None]
    return Curves(np.eye(freedom), np.zeros(freedom), means, np.ones((3, STEPS.size)))


def test_what_is_left_over_is_what_the_effects_do_not_reach() -> None:
    seen = np.array(
        [
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [3.0, 0.0, 0.0, 0.0, 0.0],
            [3.0, 2.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 4.0],
            [-3.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    squares = np.array([[0, 0, 0], [9, 0, 0], [14, 5, 1], [16, 16, 16], [9, 9, 9]])
    found = left_over(three_curves(), seen, 2)
    np.testing.assert_allclose(found, np.log(squares / 5 + OUTSIDE.least))
    # More effects than there are leave as much as all of them.
    more = left_over(three_curves(), seen, 4)
    np.testing.assert_allclose(more[:, 3], more[:, 4])


def test_an_effect_is_fitted_again_once_another_is_added() -> None:
    """Along lines that are not at right angles, the first fit alone goes too far."""
    lines = np.array([[1.0, 0.0], [0.8, 0.6]])
    steps = np.linspace(0.25, 4.0, 16)
    curves = Curves(
        np.eye(2), np.zeros(2), steps[:, None] * lines[:, None], np.ones((2, steps.size))
    )
    seen = (1.0 * lines[0] + 2.0 * lines[1])[None]
    first, second = np.exp(left_over(curves, seen, 2)[0, 1:]) - OUTSIDE.least
    assert first > 0.1
    # The first alone is 2.75 long; kept at that, it would leave 0.56 beside the best second one.
    assert second < 0.1


def test_campaigns_are_whitened_about_those_without_effect() -> None:
    curves = three_curves()
    white = 2 * np.eye(5)
    moved = Curves(white, np.full(5, 7.0), curves.means, curves.sizes)
    seen = np.random.default_rng(0).normal(size=(6, 5))
    np.testing.assert_allclose(left_over(moved, seen / 2 + 7, 2), left_over(curves, seen, 2))


def drawn(rng: np.random.Generator, count: int, outside: bool) -> np.ndarray:
    """Of known causes one number is standard normal; of unknown ones it lies 2 higher."""
    return rng.standard_normal((count, 3)) + np.array([0.0, 0.0, 2.0 * outside])


def test_the_probability_is_that_of_two_normal_distributions_by_the_prior() -> None:
    rng = np.random.default_rng(1)
    samples = [(drawn(rng, 4000, out), rng.uniform(0.5, 1.5, 4000), out) for out in (True, False)]
    found = Outside.of(samples, 2)
    left = np.array([[0.3, -1.0, x] for x in (-1.0, 1.0, 2.0, 4.0)])
    odds = PRIOR.outside / (1 - PRIOR.outside) * np.exp(2.0 * left[:, 2] - 2.0)
    np.testing.assert_allclose(found.probability(left), odds / (1 + odds), atol=0.04)


def test_how_many_campaigns_there_are_counts_nothing() -> None:
    rng = np.random.default_rng(2)
    few, many = drawn(rng, 500, True), drawn(rng, 5000, False)
    one = Outside.of([(few, np.ones(500), True), (many, np.ones(5000), False)], 2)
    tripled = np.concatenate([few] * 3)
    other = Outside.of([(tripled, np.full(1500, 9.0), True), (many, np.ones(5000), False)], 2)
    left = drawn(rng, 50, True)
    np.testing.assert_allclose(one.probability(left), other.probability(left), rtol=1e-3)


def test_where_nothing_is_withheld_the_probability_is_the_prior() -> None:
    rng = np.random.default_rng(3)
    known = (drawn(rng, 20, False), np.ones(20), False)
    for found in (Outside.of([], 2), Outside.of([known], 2), Outside.prior(2)):
        np.testing.assert_allclose(found.probability(1e3 * known[0]), PRIOR.outside)


def test_what_is_outside_is_taken_from_all_sets_alike() -> None:
    inside = np.array([[0.5, 0.3, 0.2, 0.0], [1.0, 0.0, 0.0, 0.0]])
    left = np.array([[0.0, 0.0], [0.0, 1.0]])
    outside = Outside(0.0, np.array([0.0, 50.0]))
    found = outside.beside(inside, left)
    np.testing.assert_allclose(found.sum(axis=1), 1)
    np.testing.assert_allclose(found[0], [0.25, 0.15, 0.1, 0.5])
    assert found[1, -1] == pytest.approx(1)
