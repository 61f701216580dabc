"""Route A: emulator, evidence, pairs, classes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from planar.library import PLANAR_LIBRARY
from vsr2.diagnosis.likelihood import equivalence
from vsr2.diagnosis.likelihood.emulator import design_matrix, fit_emulator
from vsr2.diagnosis.likelihood.equivalence import evened, leading_class, taken_for_same
from vsr2.diagnosis.likelihood.evidence import Change, Data, _Products, posterior, predict, tabulate
from vsr2.diagnosis.likelihood.linear_algebra import singular_values
from vsr2.diagnosis.likelihood.pairs import pair_posterior
from vsr2.diagnosis.simulated.design import Design
from vsr2.diagnosis.simulated.library import basis
from vsr2.diagnosis.which.routes import _closed

TWO = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "restitution")}


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

    def stated(*nodes):
        return pair_posterior(TWO, emulator, ("table_gain", "restitution"), one, nodes)

    table, near = stated(120, 120, 120)
    assert near.evidence[0] == pytest.approx(stated(400, 400, 400)[1].evidence[0], abs=0.05)
    # Of 4000 nodes over both priors a few share the posterior: a third of the evidence is chance.
    assert near.evidence[0] == pytest.approx(stated(4000)[1].evidence[0], abs=0.4)
    assert near.evidence[0] > stated(120)[1].evidence[0] + 5, "which 120 nodes hardly meet"
    mean = np.exp(near.nodes[0]) @ table.fine.quantiles
    np.testing.assert_allclose(mean, list(true.values()), atol=0.1)
    assert np.exp(near.nodes[0]).max() < 0.1, "many nodes share the posterior"


def common_draws(rng, draws=30, each=20, trials=60, common=0.3, own=0.1):
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
    design = common_draws(np.random.default_rng(5))
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
    design = common_draws(np.random.default_rng(7))
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
    squared = fit_emulator(TWO, logistic_design(np.random.default_rng(3), bend=0.2))
    np.testing.assert_array_equal(squared.bends, [0])
    change = tabulate(squared, "").response[0]
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


def test_singular_values_are_found_where_divide_and_conquer_fails(monkeypatch) -> None:
    # Trials that never change leave columns of zeros: gesdd may give up on those.
    matrix = np.random.default_rng(4).normal(size=(30, 8))
    matrix[:, [2, 5]] = 0.0
    expected = singular_values(matrix)

    def fails(*args, **options):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    left, size, right = singular_values(matrix)
    np.testing.assert_allclose(size, expected[1], atol=1e-12)
    np.testing.assert_allclose((left * size) @ right, matrix, atol=1e-12)


def test_effects_are_apart_where_the_better_is_picked_rightly_nine_times_in_ten(
    monkeypatch,
) -> None:
    """Twice D is about the variance of the log likelihood ratio, D its mean."""
    from scipy.stats import norm

    least = 2 * norm.ppf(0.9) ** 2
    from_a = {"b": least - 0.01, "c": least + 0.01, "d": 5 * least - 0.1, "e": 5 * least + 0.1}
    far = dict.fromkeys("abcde", 1e9)
    monkeypatch.setattr(
        equivalence, "separations", lambda leader, *_: from_a if leader == "a" else far
    )
    probability = {"none": 0.1, "a": 0.5, "b": 0.1, "c": 0.1, "d": 0.1, "e": 0.1}

    def found(exponent=1.0, confounded=None):
        tables = dict.fromkeys(probability)
        return equivalence.classes(probability, tables, {}, None, exponent, confounded or {})

    assert found() == [["a", "b"], ["c"], ["d"], ["e"]]
    # What theory takes for the same needs five times as much, whichever of both declares it.
    assert found(confounded={"a": ("d",), "e": ("a",)}) == [["a", "b", "d"], ["c"], ["e"]]
    # A likelihood that counts half separates half as well.
    assert found(0.5) == [["a", "b", "c"], ["d"], ["e"]]


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
