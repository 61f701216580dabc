"""Effects whose values for many trials are put in together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsr2.config import study_from_mapping
from vsr2.effects import Effect, Parameter, effect, registry, with_effects
from vsr2.errors import GeometryError
from vsr2.scene import Pose
from vsr2.scene.rotation import IDENTITY
from vsr2.simulation import study_trials
from vsr2.trial import Trial


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    content = {
        "rock": {"shape": "box", "size": [0.3, 0.5, 1.0], "density": 2700.0},
        "motion": {
            "mode": "grid_cosine",
            "pga_g": {"min": 0.3, "max": 0.6, "step": 0.1},
            "pgv_pga_s": {"min": 0.1, "max": 0.1, "step": 0.1},
        },
    }
    return study_trials(study_from_mapping(content, Path()))


def test_values_put_in_together_do_what_each_does_alone(trials: list[Trial]) -> None:
    # On an even top, on a sloping one, and beside the middle of a top that the rock overhangs.
    sloping = effect("base_slope").change(trials[0], {"angle": 1.0, "azimuth": 30.0})
    scene = trials[0].scene
    wide = scene.rock.parts[0].size[0]
    under = replace(
        scene.pedestal, parts=(replace(scene.pedestal.parts[0], size=(wide, 1.0, 0.5)),)
    )
    narrow = trials[0].with_scene(pedestal=under)
    rng = np.random.default_rng(0)
    together = [one for one in registry.BUILT_IN if type(one).change_each is not Effect.change_each]
    assert together
    for one in together:
        names = (*(parameter.name for parameter in one.parameters), "azimuth")
        values = [dict(zip(names, 0.02 * rng.normal(size=3), strict=True)) for _ in range(8)]
        for trial in (trials[0], sloping, narrow):
            many = one.change_each(trial, values)
            alone = [one.change(trial, own) for own in values]
            assert [repr(made.start) for made in many] == [repr(made.start) for made in alone]
            assert many == alone


def test_an_effect_of_ones_own_puts_its_values_in_together(trials: list[Trial]) -> None:
    asked = []

    class Lifted(Effect):
        name, meaning, stage = "lifted", "starts higher", "start"
        parameters = (Parameter("by", "m", 0.0, 0.0, 1.0, "uniform", "height"),)

        def at(self, values, circumstances):
            return {"by": values["by"] * (1 + circumstances.order)}

        def change(self, trial, values):
            raise AssertionError("its values are put in together")

        def change_each(self, trial, values):
            asked.append(len(values))
            x, y, z = trial.start_pose.position
            if max(own["by"] for own in values) > 0.5:
                raise GeometryError("too high")
            return [trial.starting(Pose((x, y, z + own["by"]), IDENTITY)) for own in values]

    gain = (effect("table_gain"), {"change": 0.1})
    made = with_effects(trials, [gain, (Lifted(), {"by": 0.2})])
    assert asked == [len(trials)]  # All have one scene and start.
    twice = with_effects(trials, [(Lifted(), {"by": 0.1}), (Lifted(), {"by": 0.1})])
    # The first gives each a start of its own, which the second finds out at the second trial.
    assert asked[2:] == [len(trials)] + [1] * (len(trials) - 1)
    wearing = [(effect("wear"), {"loss": 0.1}), (Lifted(), {"by": 0.1})]
    asked.clear()
    with_effects([*trials, *trials], wearing, relative_order=[0, 0, 0, 0.5, 0.5, 1, 1, 1])
    assert asked == [3, 2, 3]
    last = len(trials) - 1
    for i, (trial, before) in enumerate(zip(made, trials, strict=True)):
        rise = trial.start_pose.position[2] - before.start_pose.position[2]
        assert rise == pytest.approx(0.2 * (1 + i / last), rel=1e-12)
        assert trial.motion == before.motion.scaled(1.1, name=before.motion.name)
        assert twice[i].start_pose.position[2] == pytest.approx(trial.start_pose.position[2])
    with pytest.raises(GeometryError, match=r"^effects\.lifted: too high"):
        with_effects(trials, [(Lifted(), {"by": 0.4})])
