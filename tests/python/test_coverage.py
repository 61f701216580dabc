"""The check of a posterior: an exact one passes, a too narrow or too sure one does not."""

from __future__ import annotations

import json

import numpy as np
import pytest

from diagnosis_samples import linear, quick_training
from planted import observe, shaken_campaign
from vsr2.analysis.ranks import rank
from vsr2.coverage import check_posterior
from vsr2.coverage.coverage_scores import LEVELS, coverage_scores
from vsr2.coverage.judged import Judged, RankOf, true_label, true_labels
from vsr2.coverage.planted_campaigns import FIRST, draw_planted
from vsr2.coverage.posterior_check import check_with
from vsr2.diagnosis import Budget, diagnose_with
from vsr2.diagnosis.iteration import WORK_FILES
from vsr2.diagnosis.verdict.document import CHECK_FIGURE, CHECK_FILES
from vsr2.ensemble import ProtocolCache
from vsr2.ensemble.observed.observations import observe_campaign
from vsr2.ensemble.simulated.campaigns import draw_set
from vsr2.ensemble.simulated.look import Limit, tried_parameters
from vsr2.errors import DiagnosisError
from vsr2.posterior.calibration import label_probability
from vsr2.posterior.parameters import Parameters
from vsr2.posterior.sets import Sets
from vsr2.posterior.truth import PRIOR
from vsr2.report.messages.posterior_checks import check_sentences
from vsr2.report.posterior_check_figure import check_figure

SETS = Sets(("a", "b", "c"))


def judged_by(sharpness=1.0, width=1.0, count=400, seed=0):
    """Campaigns of which the posterior is known, answered by it or by one that is too sure."""
    rng = np.random.default_rng(seed)
    out = []
    for row in range(count):
        # Of causes of the library: outside is last.
        exact = np.append(rng.dirichlet(np.full(len(SETS) - 1, 0.4)), 0.0)
        true = int(rng.choice(len(SETS), p=exact))
        stated = exact**sharpness / (exact**sharpness).sum()
        labels = label_probability(stated[None], SETS)[0]
        order = np.argsort(-labels)
        before = np.cumsum(labels[order]) - labels[order]
        held = set(order[before < 0.9].tolist())
        samples = width * rng.standard_normal(100)
        where = rank(samples, float(rng.standard_normal()), rng)
        out.append(
            Judged(
                row, "a", "a", float(labels.max()),
                int(labels.argmax()) == true_label(SETS, true, stated),
                bool(held & true_labels(SETS, true)), len(held),
                (RankOf("a", "x", "1", 0.0, where),),
            )
        )  # fmt: skip
    return out


def test_an_exact_posterior_passes() -> None:
    scores = coverage_scores(judged_by())
    assert scores.right.low <= scores.stated <= scores.right.high
    # Sets are added until nine tenths are held, so they hold more.
    assert scores.causes.high >= 0.9
    assert scores.error[0] <= scores.error[1].high
    assert not scores.not_uniform
    assert scores.together is not None
    for level, held in zip(LEVELS, scores.together.covered, strict=True):
        assert held.low <= level <= held.high


def test_a_too_sure_or_too_narrow_posterior_fails() -> None:
    scores = coverage_scores(judged_by(sharpness=4.0, width=0.6))
    assert scores.right.high < scores.stated
    assert scores.causes.high < 0.9
    assert scores.error[0] > scores.error[1].high
    assert [one.parameter for one in scores.not_uniform] == ["x"]
    assert scores.together is not None
    # At a width of .6 the 50 % interval of a normal holds 31 %, the 90 % one 68 %.
    assert scores.together.covered[0].value == pytest.approx(0.314, abs=0.07)
    assert scores.together.covered[2].value == pytest.approx(0.676, abs=0.07)
    assert all(
        held.high < level for level, held in zip(LEVELS, scores.together.covered, strict=True)
    )


def test_the_label_of_a_pair_is_that_of_the_one_that_leads() -> None:
    probability = np.zeros(len(SETS))
    pair, alone = SETS.index(["a", "b"]), SETS.index(["b"])
    probability[[pair, alone]] = 0.6, 0.4
    assert true_label(SETS, pair, probability) == 2
    assert true_labels(SETS, pair) == {1, 2}
    assert true_label(SETS, 0, probability) == 0
    assert true_labels(SETS, 0) == {0}
    assert true_labels(SETS, SETS.outside) == {len(SETS.names) + 1}


def limits_of(library):
    return dict.fromkeys(tried_parameters(library), Limit(0.1, False))


def test_planted_causes_come_in_the_shares_of_the_prior() -> None:
    library = linear().library
    limits, count = limits_of(library), 2000
    planted = draw_planted(library, limits, count, most=2, seed=3)
    kinds, shares = [len(one.acting) for one in planted], np.array(PRIOR.sizes(2))
    # Three standard errors of a share of one half at 2000 draws are 0.034.
    for kind, share in enumerate(shares / shares.sum()):
        assert kinds.count(kind) / count == pytest.approx(share, abs=0.034)
    assert len({one.row for one in planted}) == count
    assert all(one.row >= FIRST for one in planted)
    for one in planted:
        assert one.acting == draw_set(library, limits, one.row, 3, 2)


def test_what_is_not_looked_for_is_not_planted() -> None:
    library = linear().library
    left = next(iter(library))
    excluded = [name for name in library if name != left]
    planted = draw_planted(library, limits_of(library), 100, most=2, excluded=excluded)
    assert {acting.name for one in planted for acting in one.acting} == {left}
    with pytest.raises(DiagnosisError, match="nothing can be planted"):
        draw_planted(library, limits_of(library), 1, most=2, excluded=list(library))


PLANTED = 120


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A diagnosis of the linear simulator: seconds, and its posterior is nearly exact."""
    folder = tmp_path_factory.mktemp("checked")
    simulator = linear()
    campaign = observe(shaken_campaign(8, 5, duration=1.5), linear(seed=9), nuisance=2, tier="M")
    with quick_training():
        found = diagnose_with(
            simulator, campaign, cache=folder, budget=Budget(campaigns=600, held_out=False)
        )
        found.save(folder)
        yield simulator, observe_campaign(campaign), found.content["provenance"], folder


def check(finished, planted=PLANTED):
    simulator, seen, known, folder = finished
    return check_with(simulator, seen, known, cache=ProtocolCache(folder), planted=planted)


def test_a_finished_diagnosis_is_checked_without_simulating_it_again(finished) -> None:
    found = check(finished)
    trials = found.provenance["simulated_in_this_run"] / PLANTED
    assert 0 < trials <= 40  # those that respond, of the planted campaigns alone
    again = check(finished)
    assert again.provenance["simulated_in_this_run"] == 0
    assert again.scores.causes == found.scores.causes
    assert again.tables() == found.tables()
    # 90 % are wanted; at 120 campaigns four standard errors are .11.
    assert found.scores.causes.value > 0.79
    # Of the training's 500 known campaigns it is known to .013.
    assert found.scores.causes.value == pytest.approx(found.stated, abs=0.12)
    assert abs(found.scores.right.value - found.scores.stated) < 0.18
    assert found.scores.together is not None
    assert found.scores.together.covered[2].value == pytest.approx(0.9, abs=0.12)


def test_samples_that_are_too_narrow_are_seen(finished, monkeypatch) -> None:
    sample = Parameters.sample

    def narrow(self, name, residuals, seed=0, **known):
        found = sample(self, name, residuals, seed, **known)
        middle = np.median(found, axis=0)
        return middle + 0.4 * (found - middle)

    monkeypatch.setattr(Parameters, "sample", narrow)
    found = check(finished)
    assert found.scores.together is not None
    assert found.scores.together.uniformity.p_value < 0.001
    assert found.scores.together.covered[2].high < 0.9
    assert "90 % stated" in check_sentences(found)
    assert "too few" in check_sentences(found)


def test_files_and_figure_hold_the_same_numbers(finished, tmp_path) -> None:
    found = check(finished, 30)
    path = found.save(tmp_path)
    content = json.loads(path.read_text())
    assert content["planted"] == 30
    assert content["causes"]["held"] == found.scores.causes.value
    rows = (tmp_path / "posterior_check.csv").read_text().splitlines()
    assert len(rows) == 1 + len(content["ranks"])
    assert len((tmp_path / "posterior_check_campaigns.csv").read_text().splitlines()) == 31
    assert {one.name for one in tmp_path.iterdir()} | {CHECK_FIGURE} == set(CHECK_FILES)
    assert set(CHECK_FILES) < set(WORK_FILES)  # so that --overwrite removes them
    figure = check_figure(found)
    assert len(figure.axes) == 3
    assert "planted=30" in repr(found)


def test_another_cache_holds_no_such_posterior(finished, tmp_path) -> None:
    simulator, seen, known, _ = finished
    with pytest.raises(DiagnosisError, match="holds no posterior of this diagnosis"):
        check_with(simulator, seen, known, cache=ProtocolCache(tmp_path), planted=5)


def test_a_folder_without_diagnosis_is_refused(finished, tmp_path) -> None:
    _, seen, _, _ = finished
    with pytest.raises(DiagnosisError, match="holds no finished diagnosis"):
        check_posterior(seen.campaign, "scene.yaml", out=tmp_path)
    with pytest.raises(DiagnosisError, match="plant at least 1"):
        check_posterior(seen.campaign, "scene.yaml", out=tmp_path, planted=0)


def test_settings_of_another_diagnosis_are_refused(finished) -> None:
    simulator, seen, known, folder = finished
    with pytest.raises(DiagnosisError, match="most_effects"):
        check_with(simulator, seen, known, cache=ProtocolCache(folder), planted=5, most=3)
