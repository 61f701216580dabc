"""Trials that screening drops: chosen without a look at outcomes, judged under what was chosen."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from planar import PLANAR_LIBRARY, PlanarSimulator
from planted import shaken_campaign
from vsr2.diagnosis.budget import Budget
from vsr2.diagnosis.conclusion import gap_interval_low
from vsr2.diagnosis.how_far.campaign_loss import CampaignLoss
from vsr2.diagnosis.how_far.held_out import HeldOutLosses, found_pair, posterior_draws
from vsr2.diagnosis.how_far.resimulation import FRESH, RESIMULATION_RUNS, resimulate
from vsr2.diagnosis.how_far.screened_out import SCREENED_OUT_RUNS, simulate_screened_out, surprise_p
from vsr2.diagnosis.likelihood.evidence import PREDICTED, Posterior
from vsr2.diagnosis.noise_floor import noise_floor
from vsr2.diagnosis.observed.observations import observe_campaign
from vsr2.diagnosis.pipeline import diagnose_with
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import Screening
from vsr2.diagnosis.simulated.library import NONE
from vsr2.diagnosis.simulated.simulator import Responses

TRIALS = 12
KEPT = np.arange(4)


class Thresholds:
    """Trial i overturns where the push exceeds i / 12; without it those from trial 9 on do."""

    library = PLANAR_LIBRARY
    identity = "thresholds"
    variants = ()
    nuisance_names = ("a", "b")

    def nuisance_draw(self, index):
        return np.array([0.1 * index, 0.0])

    def run(self, requests):
        pushes = [sum(values[0] for _, values in request.effects) for request in requests]
        down = [
            float(request.trial >= 9 or push > request.trial / TRIALS)
            for request, push in zip(requests, pushes, strict=True)
        ]
        return Responses(np.array(down), np.zeros(len(down)), None)


def held_out(push, negative_control=0.9, recalibrated=0.8, after=0.2, wrong=0.0):
    """Of two groups; in the second the effect chosen is half as strong; `wrong`: the control's."""
    blank = np.zeros(KEPT.size)

    def draws(value):
        return [((("wear", (value,)),), 1 + i) for i in range(PREDICTED)]

    return HeldOutLosses(
        before=blank + 1.0, after=blank + after,
        negative_control=blank + negative_control, recalibrated=blank + recalibrated,
        each={"wear": blank + after, "catch": blank + 0.9, "table_gain": blank + 0.5},
        pair=None,
        chosen={
            "before": [NONE] * 2, "after": ["wear"] * 2, "negative_control": ["catch"] * 2,
            "pair": [],
        },
        draws={
            NONE: [[((), 1 + i) for i in range(PREDICTED)]] * 2,
            "wear": [draws(push), draws(push / 2)],
            "catch": [draws(wrong)] * 2,
        },
        scaling=np.array([[0.0, 1.0], [0.0, 1.0]]),
        predicted_before=blank + 0.4, predicted_after=blank + 0.8, predicted_pair=None,
        group=np.array([0, 1, 0, 1]), ranked=[["wear", "catch"]] * 2,
    )  # fmt: skip


MOTION = np.array([0, 1, 0, 1, 0, 1, 0, 1, 2, 0, 1, 0])
SCREENING = Screening(
    KEPT,
    KEPT[:0],
    np.where(np.arange(TRIALS) < 9, 0.02, 0.98),
    np.ones(TRIALS, dtype=bool),
    0,
    KEPT,
)


def losses_of(push, overturned, gap_low=-1.0, motion=MOTION, **losses):
    campaign = shaken_campaign(3, 4)
    rows = tuple(
        dataclasses.replace(trial, overturned=bool(down))
        for trial, down in zip(campaign.trials, overturned, strict=True)
    )
    seen = dataclasses.replace(campaign, trials=rows)
    stated = held_out(push, **losses)
    with SimulationCache(Thresholds()) as store:
        screened_out = simulate_screened_out(store, SCREENING, stated, motion)
        assert store.asked <= SCREENED_OUT_RUNS * screened_out.trials.size
    observed = dataclasses.replace(observe_like(seen), motion=motion)
    return screened_out, CampaignLoss(
        observed, KEPT, np.full(KEPT.size, 0.1), stated, screened_out, gap_low
    )


def observe_like(campaign):
    """Observations of so small a campaign, which a diagnosis would refuse."""
    many = shaken_campaign(10, 4)
    seen = observe_campaign(
        dataclasses.replace(
            many, trials=tuple(dataclasses.replace(t, overturned=False) for t in many.trials)
        ),
        "B",
    )
    count = len(campaign)
    return dataclasses.replace(
        seen,
        campaign=campaign,
        overturned=np.array([float(t.overturned) for t in campaign.trials]),
        motion=MOTION,
        **{
            name: getattr(seen, name)[:count]
            for name in ("order", "session", "specimen", "log_pga", "log_ratio", "features")
        },
    )


def test_screened_out_trials_do_what_the_effect_makes_of_them() -> None:
    screened_out, _ = losses_of(0.6, np.zeros(TRIALS))
    np.testing.assert_array_equal(screened_out.trials, np.arange(4, 12))
    # Motion 2 has no kept trial: its trial 8 is judged with the first group.
    np.testing.assert_array_equal(screened_out.group, [0, 1, 0, 1, 0, 0, 1, 0])
    standing = (0 + 0.5) / (PREDICTED + 1)
    fallen = 1 - standing
    # As certain as all simulations make it where nothing changes; its own where it does.
    np.testing.assert_allclose(screened_out.before, [0.02] * 5 + [0.98] * 3)
    np.testing.assert_allclose(screened_out.negative_control, screened_out.before)
    # 4 / 12 and 6 / 12 are below 0.6, 5 / 12 and 7 / 12 not below 0.3, 8 / 12 is above 0.6.
    np.testing.assert_allclose(
        screened_out.after, [fallen, 0.02, fallen, 0.02, 0.02, 0.98, 0.98, 0.98]
    )
    assert screened_out.certain.all()


def test_an_effect_that_turns_trials_wrongly_closes_less() -> None:
    """All trials do as without effect; of the kept ones, the effect seems to explain much."""
    stands = (np.arange(TRIALS) >= 9).astype(float)
    _, calm = losses_of(0.2, stands)
    moved, harmed = losses_of(0.6, stands)
    assert calm.changed == 0
    assert harmed.changed == 2
    lost = -np.log(1 - moved.after[[0, 2]]) + np.log(0.98)
    assert harmed.mean("after")["value"] - calm.mean("after")["value"] == pytest.approx(
        lost.sum() / TRIALS
    )
    assert harmed.left == pytest.approx(calm.left + lost.sum() / (KEPT.size * 0.9))
    rows = harmed.rows()
    assert [rows[i]["after"] > 0.9 for i in (4, 5, 6)] == [True, False, True]
    # What was not chosen is taken to leave them as they are.
    assert harmed.mean("table_gain")["value"] == calm.mean("table_gain")["value"]
    assert harmed.mean("wear")["value"] == harmed.mean("after")["value"]


def test_a_control_answers_for_what_it_does_to_screened_out_trials() -> None:
    found = (np.arange(TRIALS) >= 9).astype(float)
    found[[4, 6]] = 1.0
    idle, busy = (losses_of(0.2, found, wrong=push)[1] for push in (0.0, 0.6))
    screened_out = losses_of(0.2, found, wrong=0.6)[0]
    # 4 / 12 to 7 / 12 are below 0.6: two of these trials fell, two stood.
    fallen = 1 - 0.5 / (PREDICTED + 1)
    np.testing.assert_allclose(screened_out.negative_control, [fallen] * 4 + [0.02] + [0.98] * 3)
    gain = 2 * (np.log(fallen) - np.log(0.02)) + 2 * (np.log(1 - fallen) - np.log(0.98))
    assert idle.mean("negative_control")["value"] - busy.mean("negative_control")[
        "value"
    ] == pytest.approx(gain / TRIALS)
    assert busy.mean("catch")["value"] == pytest.approx(busy.mean("negative_control")["value"])


def test_an_effect_that_turns_trials_rightly_closes_more() -> None:
    found = (np.arange(TRIALS) >= 9).astype(float)
    found[[4, 6]] = 1.0
    _, without = losses_of(0.2, found)
    _, with_them = losses_of(0.6, found)
    assert with_them.left < 0.3 < without.left


@pytest.mark.parametrize(
    ("losses", "spared"),
    [
        ({}, 0.2),
        ({"negative_control": 0.5}, 0.5),
        # Controls that make it worse add nothing.
        ({"negative_control": 1.2, "recalibrated": 1.4}, 0.0),
    ],
)
def test_the_headline_is_closure_minus_the_better_control_s(losses, spared) -> None:
    stands = (np.arange(TRIALS) >= 9).astype(float)
    _, found = losses_of(0.2, stands, gap_low=0.01, motion=np.arange(TRIALS) % 2, **losses)
    # Of the four trials that are kept; the others lie on the floor.
    assert found.closure("after")["value"] == pytest.approx((1.0 - 0.2) / (1.0 - 0.1))
    assert found.headline()["value"] == pytest.approx((1.0 - 0.2 - spared) / (1.0 - 0.1))
    assert losses_of(0.2, stands, **losses)[1].headline()["value"] is None


def test_closure_s_interval_is_over_motions() -> None:
    """A quarter of the resamples of two motions holds either one twice."""
    stands = (np.arange(TRIALS) >= 9).astype(float)
    after = np.array([0.2, 0.6, 0.2, 0.6])
    _, found = losses_of(0.2, stands, gap_low=0.01, motion=np.arange(TRIALS) % 2, after=after)
    closure = found.closure("after")
    assert closure["value"] == pytest.approx((0.8 + 0.4) / (0.9 + 0.9))
    assert closure["ci95"] == pytest.approx([0.4 / 0.9, 0.8 / 0.9])
    headline = found.headline()
    assert headline["ci95"] == pytest.approx([0.2 / 0.9, 0.6 / 0.9]), "a rescaling closes 0.2"


def test_the_gap_s_interval_is_the_wider_of_two() -> None:
    # Over motions and in gap-free campaigns, whose share of the trials is that of the kept ones.
    stands = (np.arange(TRIALS) >= 9).astype(float)
    alike = np.arange(TRIALS) % 2
    narrow = losses_of(0.2, stands, gap_low=0.9, motion=alike)[1].excess("before")["ci95"]
    wide = losses_of(0.2, stands, gap_low=-0.3, motion=alike)[1].excess("before")["ci95"]
    assert narrow[0] > 0
    assert wide == [pytest.approx(-0.3 * KEPT.size / TRIALS), narrow[1]]

    def lower(spread: float, second: float = 0.0) -> float:
        null = SimpleNamespace(
            floor=np.full(4, 0.1), truth=np.zeros(41), gap=spread * np.linspace(-1, 1, 41)
        )
        found = SimpleNamespace(loss=np.array([0.5, 0.7, 0.5 + second, 0.7 + second]))
        return gap_interval_low(SimpleNamespace(calibration=null), found, np.array([0, 0, 1, 1]), 0)

    # Both motions have a mean of 0.5 above the floor; 97.5 % of null campaigns lie below 0.95.
    assert lower(0.01) == pytest.approx(0.5 - 0.0095)
    assert lower(0.4) == pytest.approx(0.5 - 0.38)
    assert lower(0.0) == pytest.approx(0.5)
    # A quarter of the resamples of two motions holds the first one twice.
    assert lower(0.01, second=1.0) == pytest.approx(0.5)


class Jittery(Thresholds):
    """Trials 0 and 1 of four fall if perturbed, 2 with other placement; nuisances turn all."""

    def run(self, requests):
        down = [
            r.nuisance > 0 or (r.trial < 2 if r.replicate < 0 else r.replicate > 0 and r.trial == 2)
            for r in requests
        ]
        return Responses(np.array(down, dtype=float), np.zeros(len(down)), None)


def test_the_noise_floor_s_layers_are_kept_apart() -> None:
    campaign = shaken_campaign(3, 4)
    observed = observe_like(
        dataclasses.replace(
            campaign,
            trials=tuple(dataclasses.replace(t, overturned=False) for t in campaign.trials),
        )
    )
    with SimulationCache(Jittery()) as store:
        layers = noise_floor(store, observed, SCREENING)
    assert (layers["numerical"], layers["input"], layers["nuisance"]) == (0.5, 0.25, 1.0)
    assert layers["time_step"] is layers["solver"] is None
    assert layers["trials"] == KEPT.size
    assert layers["physical"] is layers["physical_expected"] is None


def test_repeats_are_expected_to_differ_as_often_as_screening_says() -> None:
    campaign = shaken_campaign(3, 4)
    rows = [dataclasses.replace(t, overturned=False) for t in campaign.trials]
    for of, again in ((2, 4), (5, 10)):
        rows[again] = dataclasses.replace(
            rows[again], motion_file=rows[of].motion_file, overturned=True
        )
    observed = observe_like(dataclasses.replace(campaign, trials=tuple(rows)))
    alike = np.arange(TRIALS) != 2
    probability = np.where(alike, SCREENING.probability, 0.3)
    screening = dataclasses.replace(SCREENING, alike=alike, probability=probability)
    with SimulationCache(Jittery()) as store:
        layers = noise_floor(store, observed, screening)
    assert (layers["repeats"], layers["physical"]) == (2, 1.0)
    # Of trial 2 one in 0.42, of trial 5, which always ended alike, none.
    assert layers["physical_expected"] == pytest.approx(0.21)


def test_what_is_kept_does_not_depend_on_outcomes(monkeypatch) -> None:
    monkeypatch.setattr("vsr2.diagnosis.which.amortised.TREES", 30)
    campaign = shaken_campaign(8, 6, duration=2.5, pga=(0.4, 1.3), session_size=12)
    library = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "catch")}
    kept = []
    for fallen in (lambda i: i % 2 == 0, lambda i: i < 40):
        rows = tuple(
            dataclasses.replace(t, overturned=fallen(i)) for i, t in enumerate(campaign.trials)
        )
        observed = dataclasses.replace(campaign, trials=rows)
        found = diagnose_with(
            PlanarSimulator(observed, library=library, seed=1),
            observed,
            tier="B",
            budget=Budget(simulations=1500),
        )
        kept.append([row["uncertain"] for row in found.trials])
    assert kept[0] == kept[1]
    assert 5 < sum(kept[0]) < 43


@pytest.mark.parametrize(("against", "low"), [(1, 0.3), (8, 0.0)])
def test_many_outcomes_against_certainty_are_a_surprise(against, low) -> None:
    """50 trials with p = 0.02: one that overturned is expected, eight are not."""
    outcome = (np.arange(50) < against).astype(float)
    p = surprise_p(outcome, np.full(50, 0.02))
    assert p == pytest.approx([1 - np.exp(-1.0), 1.0e-5][against > 1], rel=0.05)
    assert p >= low
    assert surprise_p(np.zeros(0), np.zeros(0)) == 1.0


def test_draws_follow_the_posterior(tmp_path) -> None:
    """A posterior that is narrow in one nuisance and not in the other takes draws by the first."""
    rng = np.random.default_rng(3)
    nuisances = rng.standard_normal((400, 2))

    class Table:
        weights = np.eye(2)
        fine = type("Fine", (), {"quantiles": np.array([[0.2], [0.8]])})()

    found = Posterior(
        evidence=np.zeros(1),
        nodes=np.log([[0.25, 0.75]]),
        nuisance=np.array([[[1.5, 0.0], [-1.0, 0.0]]]),
        covariance=np.diag([1e-4, 1.0])[None],
        best=np.zeros(1),
    )
    draws = posterior_draws(PLANAR_LIBRARY, ("wear",), Table(), found, nuisances)
    values = [effects[0][1][0] for effects, _ in draws]
    assert len(draws) == PREDICTED
    assert sorted(np.unique(values, return_counts=True)[1]) == [PREDICTED // 4, 3 * PREDICTED // 4]
    for (_, number), value in zip(draws, values, strict=True):
        wanted = 1.5 if value == min(values) else -1.0
        assert nuisances[number - 1, 0] == pytest.approx(wanted, abs=0.1)
    assert np.std([nuisances[number - 1, 1] for _, number in draws]) > 0.4
    assert all(
        effects == ()
        for effects, _ in posterior_draws(PLANAR_LIBRARY, (), Table(), found, nuisances)
    )


def test_a_pair_is_found_where_a_second_effect_helps() -> None:
    floor, motion = np.full(KEPT.size, 0.1), np.arange(KEPT.size)
    one = held_out(0.5)
    stated = {"after": ["com_offset", "catch"], "pair": ["catch", "base_slope"]}

    def found(after, pair, chosen=stated):
        losses = {"after": floor + after, "pair": floor + pair}
        tried = dataclasses.replace(one, **losses, chosen=one.chosen | chosen)
        return found_pair(tried, floor, motion, 0)

    pair = found(0.6, 0.2)
    assert pair.names == ("base_slope", "catch")
    assert pair.probability == 1.0
    assert pair.left == pytest.approx(0.2 / 0.9)
    assert pair.closed == pytest.approx(0.4 / 0.6)
    assert pair.beyond == pytest.approx(0.5 / 0.9), "a rescaling leaves 0.7"
    assert found(0.9, 0.75).beyond == pytest.approx(-0.05 / 0.9)
    assert found(0.2, 0.6) is None, "one effect does better"
    other = {"after": ["wear", "catch"], "pair": ["catch", "base_slope"]}
    assert found(0.6, 0.2, other) is None, "each group chose another pair"
    assert found_pair(one, floor, motion, 0) is None, "none was tried"


class Undecided(Thresholds):
    """Under an effect every second draw of nuisances overturns all."""

    def run(self, requests):
        down = [float(bool(r.effects) and r.nuisance % 2 == 0) for r in requests]
        return Responses(np.array(down), np.zeros(len(down)), None)


def resimulated(push, overturned, simulator=Thresholds):
    campaign = shaken_campaign(3, 4)
    rows = tuple(
        dataclasses.replace(trial, overturned=bool(down))
        for trial, down in zip(campaign.trials, overturned, strict=True)
    )
    seen = observe_like(dataclasses.replace(campaign, trials=rows))
    requests = []

    class Noting(simulator):
        def run(self, wanted):
            requests.extend(wanted)
            return super().run(wanted)

    with SimulationCache(Noting()) as store:
        found = resimulate(store, seen, SCREENING, held_out(push), np.full(KEPT.size, 0.1), seed=0)
    return found, requests


def test_what_is_named_must_close_the_gap_in_simulations_too() -> None:
    found, requests = resimulated(0.5, [1] * 4 + [0] * 8)
    # Trials 0 to 2 fall under the effect of their group, as they did; trial 3 does not.
    before, after, own = np.log(18), -np.log(8.5 / 9), -np.log(7.5 / 8)
    assert found.closure.value == pytest.approx(0.75 * (before - after) / (before - own))
    assert found.predicted == pytest.approx(0.8 / 0.9)
    assert not found.short
    assert len(requests) == RESIMULATION_RUNS * KEPT.size
    assert {request.replicate for request in requests} == {FRESH}
    useless, _ = resimulated(0.0, [1] * 4 + [0] * 8)
    assert useless.closure.value == 0.0
    assert useless.short, "the emulator predicted 0.8 of every trial's loss"
    # Of the first motion's trials one falls, of the second's none: the more is within chance.
    doubtful, _ = resimulated(0.1, [1] * 4 + [0] * 8)
    assert doubtful.closure.low < 0.5 * doubtful.predicted < doubtful.closure.high
    assert not doubtful.short
    # The floor is what simulations without effect lose, however those with it scatter.
    scattered, _ = resimulated(0.5, [1] * 4 + [0] * 8, Undecided)
    assert scattered.closure.value == pytest.approx((before - np.log(2)) / (before - own))
    worse, _ = resimulated(0.5, [0] * 12)
    assert worse.closure.value < 0
    assert worse.short
