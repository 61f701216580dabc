"""What effects made is kept for later calls, and what trials share is made once for all of them."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from diagnosis_samples import made_trials
from planted import shaken_campaign
from vsr2.causes.margins.margin_search import _parts
from vsr2.config import study_from_mapping
from vsr2.effects import each_with_effects, effect, in_order
from vsr2.effects.actuation import InputFilter, TableGain
from vsr2.effects.apply import MadeEarlier, Sought
from vsr2.effects.geometry import EdgeRounding
from vsr2.effects.rounding import _PAIRS, _touching
from vsr2.ensemble import Hypotheses
from vsr2.ensemble.simulated.scene_simulator import KEPT_MOTIONS, KEPT_SCENES, SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.trial import Trial

NAMES = ("edge_rounding", "friction", "input_filter", "table_gain", "table_resonance", "placement")
BOX = {
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 3.0},
}
HYPOTHESES = Hypotheses({name: effect(name) for name in (*NAMES, "wear")}, contact_family=())
CALLED = {"edge_rounding": EdgeRounding, "input_filter": InputFilter, "table_gain": TableGain}


@pytest.fixture(scope="module")
def simulator(tmp_path_factory: pytest.TempPathFactory) -> SceneSimulator:
    study = study_from_mapping(BOX, base=tmp_path_factory.mktemp("study"))
    shaken = shaken_campaign(5, 4, duration=2.0, pga_g=(0.6, 1.3), session_size=10)
    return SceneSimulator(shaken, study, hypotheses=HYPOTHESES)


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often some effects changed a trial."""
    counts: Counter[str] = Counter()

    def counted(name: str, change):
        def inner(self, trial: Trial, values):
            counts[name] += 1
            return change(self, trial, values)

        return inner

    for name, kind in CALLED.items():
        monkeypatch.setattr(kind, "change", counted(name, kind.change))
    return counts


@pytest.fixture(scope="module")
def trials(simulator: SceneSimulator) -> list[Trial]:
    return [trial for _, trial in sorted(made_trials(simulator, (), 0, 0, range(8)).items())]


def given(gains: dict[int, float]):
    """All effects of `NAMES` at the far ends of their priors, but the gain."""
    acting = in_order({name: effect(name) for name in NAMES})
    gained = Sought({i: {"change": gain} for i, gain in gains.items()})
    return [(one, gained if one.name == "table_gain" else one.extreme()) for one in acting]


def alone(trials: list[Trial], index: int, gain: float) -> Trial:
    acting = [(one, {"change": gain} if one.name == "table_gain" else v) for one, v in given({})]
    return dict(each_with_effects(trials, acting, seed=3, only={index}))[index]


def test_values_by_trial_act_as_in_each_alone(trials: list[Trial]) -> None:
    gains = {i: 0.1 * i for i in range(0, 8, 2)}
    together = dict(each_with_effects(trials, given(gains), seed=3))
    for i, trial in together.items():
        assert trial == alone(trials, i, gains.get(i, 0.0)), i
    # 0 is null, and the others are not named.
    assert [name_in(together[i], "table_gain") for i in range(4)] == [False, False, True, False]


def name_in(trial: Trial, name: str) -> bool:
    return any(one.effect.name == name for one in trial.effects)


def test_what_was_made_earlier_is_not_made_again(trials: list[Trial], called) -> None:
    earlier = MadeEarlier(most=8)
    calls = [{i: 0.1 * (k + 1) for i in range(8)} for k in range(3)] + [{}]
    for gains in calls:
        made = dict(each_with_effects(trials, given(gains), seed=3, made=earlier))
        for i, trial in made.items():
            assert trial == alone(trials, i, gains.get(i, 0.0)), i
        called_by_alone = len(made)
        called.subtract({"edge_rounding": called_by_alone, "input_filter": called_by_alone})
    assert called["edge_rounding"] == 1
    motions = len({trial.motion.sha256 for trial in trials})
    assert called["input_filter"] == motions


def test_motions_that_do_not_fit_are_made_again(trials: list[Trial], called) -> None:
    earlier = MadeEarlier(most=3)
    for _ in range(2):
        gains = dict.fromkeys(range(8), 0.1)
        made = dict(each_with_effects(trials, given(gains), seed=3, made=earlier))
    assert made[5] == alone(trials, 5, 0.1)
    assert len(earlier._moving) == 3


def requests(gains: np.ndarray, nuisance: int = 2) -> list[Request]:
    scene = (("edge_rounding", (0.004,)), ("wear", (0.1,)), ("input_filter", (12.0,)))
    return [
        Request(i, (*scene, ("table_gain", (gain,))), nuisance, 1)
        for i, gain in enumerate(gains.tolist())
    ]


def test_a_scene_at_many_gains_is_made_once_and_answers_alike(simulator, called) -> None:
    gains = np.linspace(-0.3, 0.6, 20)
    asked = requests(gains)
    # A trial at two gains, one of them twice.
    asked += [asked[3]._replace(effects=requests(gains[::-1])[3].effects), asked[3]]
    together = simulator.run(asked)
    # `wear` grows over the campaign: a scene for each value, each of them rounded before.
    assert called["edge_rounding"] == 1
    again = simulator.run(asked)
    assert called["edge_rounding"] == 1
    for found in (together, again):
        for i in (0, 3, 7, 20, 21):
            single = simulator.run([asked[i]._replace(nuisance=2)])
            assert single.peak_tilt[0] == found.peak_tilt[i]
            assert single.overturned[0] == found.overturned[i]
    other = SceneSimulator(simulator._campaign, simulator._study, hypotheses=HYPOTHESES)
    np.testing.assert_array_equal(other.run(asked).peak_tilt, together.peak_tilt)


def test_scenes_asked_for_last_are_kept(simulator) -> None:
    for nuisance in range(1, KEPT_SCENES + 3):
        simulator.run(requests(np.array([0.1, 0.2]), nuisance))
    kept = {scene.nuisance for scene in simulator._earlier}
    assert kept == set(range(3, KEPT_SCENES + 3))


def test_margins_are_sought_together_as_long_as_their_motions_are_kept() -> None:
    of_scene = np.repeat([0, 1, 2, 3, 4, 5], [60, 60, 60, 300, 10, 10])
    parts = _parts(of_scene)
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(of_scene.size))
    assert max(part.size for part in parts) <= KEPT_MOTIONS
    assert max(np.unique(of_scene[part]).size for part in parts) == KEPT_SCENES
    assert _parts(np.zeros(0, dtype=np.int64)) == []


def test_pairs_of_vertices_and_planes_are_those_of_the_full_table() -> None:
    rng = np.random.default_rng(5)
    vertices, normals = rng.normal(size=(700, 3)), rng.normal(size=(900, 3))
    assert vertices.shape[0] * normals.shape[0] > 2 * _PAIRS
    offsets = rng.normal(2.0, 1.0, 900)
    vertex, plane = _touching(vertices, normals, offsets, 0.01)
    inside = -(vertices @ normals.T) - offsets
    expected = np.nonzero(inside < 0.01)
    np.testing.assert_array_equal(np.stack([vertex, plane]), np.stack(expected))
