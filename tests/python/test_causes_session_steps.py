"""Effects that act from a session on, by margins of scenes that have them throughout."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from vsr2.causes.margins.acting_posterior import sample_posterior
from vsr2.causes.margins.cause_space import CauseSpace, cause_space
from vsr2.causes.margins.margin_emulator import fit_emulator
from vsr2.causes.margins.outcome_model import OutcomeModel, emulated_nuisances
from vsr2.causes.margins.session_steps import SeenScenes, _Joined, _scale, session_steps
from vsr2.causes.margins.trial_groups import TrialGroups
from vsr2.effects import Circumstances, Parameter, library

TRIALS = 60
SESSIONS = [str(i // 12) for i in range(TRIALS)]
ORDER = np.linspace(0, 1, TRIALS)


def space() -> CauseSpace:
    return CauseSpace(library(), ("slenderness", "registration", "friction"))


def emulator(space, rng):
    """Margins of trials that slenderness moves most, and the others each in its way."""
    points = space.draw(150, rng)
    acts = rng.random((150, len(space.names))) < 0.6
    nuisances = rng.standard_normal((150, 1))
    features = np.hstack([space.features(points, acts), emulated_nuisances(nuisances)])
    slopes = rng.normal(0, 0.1, (features.shape[1], TRIALS))
    slopes[0] = -0.8
    margins = rng.normal(0, 0.2, TRIALS) + features @ slopes
    groups = TrialGroups(np.arange(TRIALS), np.ones((1, TRIALS), dtype=bool))
    return fit_emulator(features, margins, np.zeros(150, dtype=int), groups)


def seen(learnt, count):
    return SeenScenes(learnt, np.zeros((count, 1)), np.zeros(count))


@pytest.fixture(scope="module")
def steps():
    return session_steps(space(), ORDER, SESSIONS)


@pytest.fixture(scope="module")
def learnt():
    return emulator(space(), np.random.default_rng(0))


def drawn(steps, count, seed=1):
    """Points, and nothing that acts."""
    together = steps.together
    points = together.draw(count, np.random.default_rng(seed))
    return points, np.zeros((count, len(together.names)), dtype=bool)


def test_a_step_needs_the_margins_of_all_its_parts() -> None:
    full = cause_space(library())
    assert session_steps(full, ORDER, SESSIONS).names == ("change_point", "session")
    assert session_steps(full, ORDER, SESSIONS, ["session"]).names == ("change_point",)
    without = cause_space(library(), ["friction"])
    assert session_steps(without, ORDER, SESSIONS).names == ("change_point",)
    assert not set(full.names) & {"change_point", "session", "placement", "outcome_rule"}


@pytest.mark.parametrize("sessions", [SESSIONS, ["one"] * TRIALS])
def test_a_step_comes_where_the_effect_has_it(sessions) -> None:
    steps = session_steps(space(), ORDER, sessions)
    effect = library()["session"]
    points, _ = drawn(steps, 40)
    own = points[:, len(steps.space.coordinates) :]
    late = steps.after("session", own)
    known = tuple(dict.fromkeys(sessions))
    for row, point in zip(late, own, strict=True):
        own_values = steps.own.values("session", point)
        values = effect.extreme() | {"at": own_values[0]}
        rng = np.random.default_rng(0)
        expected = [
            not effect.is_null(effect.at(values, Circumstances(order, session, known, rng)))
            for order, session in zip(ORDER, sessions, strict=True)
        ]
        # Places are tabled to 1/400, so that a step may miss one of 60 trials.
        assert np.sum(row != expected) <= (0 if len(known) > 1 else 1)
    assert late.any(axis=0)[-1]
    assert not late.all(axis=0)[0]


def test_before_the_step_is_the_scene_without_it_and_after_it_the_scene_with_it(
    steps, learnt
) -> None:
    points, acts = drawn(steps, 30)
    names = list(steps.together.names)
    plain = steps.margins(seen(learnt, 30), points, acts)[0]
    stepped = acts.copy()
    stepped[:, names.index("change_point")] = True
    mean, *variances = steps.margins(seen(learnt, 30), points, stepped)
    first = len(steps.space.coordinates)
    late = steps.after("change_point", points[:, first:])
    np.testing.assert_array_equal(mean[~late], plain[~late])
    # A tilt of the whole campaign by the same change of slenderness, in units of its own range.
    throughout, on = points.copy(), acts.copy()
    change = points[
        :, first + list(steps.own.feature_names).index("change_point.slenderness_change")
    ]
    throughout[:, 0] = change * 0.15 / 0.06
    on[:, 0] = True
    together, *its = steps.margins(seen(learnt, 30), throughout, on)
    np.testing.assert_allclose(mean[late], together[late], atol=1e-9)
    for variance, own in zip(variances, its, strict=True):
        assert (variance >= own - 1e-12).all()


def test_turns_add_and_a_motion_grows_by_its_factor(steps, learnt) -> None:
    """With the step alone, and with the turn that the whole campaign has."""
    points, acts = drawn(steps, 1)
    first, names = len(steps.space.coordinates), list(steps.together.names)
    labels = [one.parameter.name for one in steps.own.coordinates]
    own_names = [steps.own.names[one.effect] for one in steps.own.coordinates]

    def column(parameter):
        return first + next(
            k
            for k, (name, label) in enumerate(zip(own_names, labels, strict=True))
            if (name, label) == ("session", parameter)
        )

    points[:] = 0.0
    points[0, column("at")] = 0.0
    points[0, column("registration_yaw")] = 0.5
    acts[0, [names.index("session"), names.index("registration")]] = True
    yaw = [one.parameter.name for one in steps.space.coordinates].index("yaw")
    points[0, yaw] = 0.4
    values = steps.own.values("session", points[0, first:])
    turn = [p.name for p in library()["session"].parameters].index("registration_yaw")
    assert values[turn] == pytest.approx(15.0)
    mean, *_ = steps.margins(seen(learnt, 1), points, acts)
    late = steps.after("session", points[:, first:])[0]
    both, alone = points.copy(), acts.copy()
    both[0, yaw] = 0.4 + 15 / 180
    alone[0, names.index("session")] = False
    expected, *_ = steps.margins(seen(learnt, 1), both, alone)
    np.testing.assert_allclose(mean[0, late], expected[0, late], atol=1e-6)
    assert late.sum() == TRIALS - 12
    # The motion by 15 % more, its greatest share, and no turn.
    points[0, column("registration_yaw")] = 0.0
    points[0, column("table_gain_change")] = 1.0
    stronger, *_ = steps.margins(seen(learnt, 1), points, acts)
    alone_mean, *_ = steps.margins(seen(learnt, 1), points, alone)
    shift = (alone_mean - stronger)[0]
    np.testing.assert_allclose(shift[late], np.log(1.15), atol=1e-9)
    np.testing.assert_allclose(shift[~late], 0.0, atol=0)


def test_a_campaign_whose_rock_grows_slender_midway_has_a_step(steps, learnt) -> None:
    """Outcomes by margins of a rock that a change point makes more slender; no draw, no scatter."""
    first, names = len(steps.space.coordinates), list(steps.together.names)
    points, acts = drawn(steps, 1, seed=5)
    acts[0, names.index("change_point")] = True
    own = list(steps.own.feature_names)
    points[0, first + own.index("change_point.at")] = 0.5
    points[0, first + own.index("change_point.slenderness_change")] = 1.0
    mean, *_ = steps.margins(seen(learnt, 1), points, acts)
    motions = np.array([f"m{i % 20}" for i in range(TRIALS)])
    found = {}
    for label, margins in (("planted", mean[0]), ("none", learnt.levels.centre)):
        model = OutcomeModel(steps.together, learnt, margins < 0, motions, 1, steps=steps)
        posterior = sample_posterior(
            model, np.arange(TRIALS), np.random.default_rng(2), particles=300
        )
        share = posterior.particles.acts.mean(axis=0)
        found[label] = max(share[names.index(name)] for name in steps.names)
    # Each is expected with 1/3.
    assert found["planted"] > 0.8
    assert found["none"] < 0.6


def test_a_step_from_an_infinite_null_has_a_size() -> None:
    """A corner has no null: its range begins at the end of the prior next to infinity."""
    stepped = Parameter("corner", "Hz", math.inf, 5.0, 40.0, "loguniform", "cut-off")
    own = replace(stepped, lower=10.0)
    joined = _Joined(own, stepped, "input_filter", 0, "", None)
    share = np.array([0.0, 0.5, 1.0])
    expected = np.log(10 / 40) / np.log(5 / 40)
    np.testing.assert_allclose(_scale(joined, share), expected, rtol=1e-4)
