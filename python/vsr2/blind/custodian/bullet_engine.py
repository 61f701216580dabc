"""The engine `bullet`: a scene on our own core, with the library's effects."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.custodian.engine import Nuisances, TrialInput
from vsr2.blind.form.pack_settings import EngineName
from vsr2.blind.mujoco import Drawable, Parameter, Response
from vsr2.config import Study
from vsr2.config.study import BoxRock, YawStart
from vsr2.effects import (
    Effect,
    EffectRangeWarning,
    chosen,
    library,
    with_effects,
)
from vsr2.effects.registry import place
from vsr2.errors import BlindError, SimulationError
from vsr2.motion import Record, build_recorded_motion
from vsr2.results import TrialLog
from vsr2.scene.rotation import quaternion_product

if TYPE_CHECKING:
    from vsr2.scene import Pose, Scene
    from vsr2.trial import Trial

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BulletConstants:
    """How the core is run; chosen by hand, sealed with a pack.

    Attributes:
        stop: tilt up to which a falling rock is simulated at least [rad]: farther than a series is
            written.
    """

    stop: float = 1.4


BULLET_ENGINE = BulletConstants()

_SCENE_EFFECTS = 1
"""Stream of what the scene's own effects draw, beside a drawn effect of the same name."""


class BulletEngine:
    """Trials of a study on the native core; effects are those of `vsr2.effects`.

    The study's own effects act in every trial, in one order of application with those that are
    drawn. Nuisances scale the block's edges, the energy that its impacts leave and its friction.

    Raises:
        BlindError: the rock is no block on `mode: yaw`.
    """

    name = EngineName.BULLET.value

    def __init__(self, study: Study) -> None:
        if not isinstance(study.rock, BoxRock):
            raise BlindError(
                f"study {study.name!r}: rock.shape is {study.rock.shape!r}, but the engine bullet "
                "of the blind check takes box; give such a scene, or --engine mujoco"
            )
        if not isinstance(study.rock.start, YawStart):
            raise BlindError(
                f"study {study.name!r}: rock.start.mode is {study.rock.start.mode!r}, but the "
                "engine bullet of the blind check takes yaw; change it, or --engine mujoco"
            )
        self._study = study

    @property
    def versions(self) -> Mapping[str, str]:
        """Of what simulates."""
        from vsr2 import _native

        return {key: str(value) for key, value in _native.build_facts().items()}

    @property
    def static_acceleration(self) -> float:
        """Acceleration of uplift, g b / h [m/s^2]."""
        assert isinstance(self._study.rock, BoxRock)
        width, _, height = self._study.rock.size
        return self._study.engine.gravity * width / height

    @cached_property
    def effects(self) -> Mapping[str, Drawable]:
        """The library's, but those that this scene cannot have, or has and cannot have twice."""
        step = self._study.engine.time_step
        inputs = [TrialInput(step, np.zeros(100))]
        (trial,) = self._with_effects(self._trials(inputs, Nuisances(), step), inputs, {})
        # What comes in over a campaign does not act in its first trial.
        acting = {
            own.name
            for one, values in chosen(self._study.effects)
            for own in one.acting_once(values)
        }
        found = {
            name: self._drawable(effect, trial)
            for name, effect in library().items()
            if name not in acting
        }
        return {name: drawable for name, drawable in found.items() if drawable is not None}

    @staticmethod
    def _drawable(effect: Effect, trial: Trial) -> Drawable | None:
        """With the first parameter that is no secondary one as its strength.

        Further ones stay null, since each would act whatever the strength.
        """
        open_ones = [p for p in effect.parameters if p.prior != "fixed"]
        primary = [p for p in open_ones if not p.secondary]
        if not primary:
            return None
        free = [primary[0], *(p for p in open_ones if p.secondary)]
        null = effect.nominal(trial)
        strength, *others = (
            Parameter(p.name, p.unit, null[p.name], p.lower, p.upper, math.isinf(null[p.name]))
            for p in free
        )
        return Drawable(effect.name, strength, tuple(others), effect.stage == "order")

    def run(self, inputs: Iterable[TrialInput], series_interval: float) -> Iterator[Response]:
        """Simulate the trials of one campaign, in their order.

        They have one set of nuisances and effects, and one seed of the campaign.
        """
        from vsr2.simulation import run_batch

        ordered = list(inputs)
        if not ordered:
            return
        first = ordered[0]
        trials = self._trials(ordered, first.nuisances, series_interval)
        acting = {name: dict(values) for name, values in first.effects.items()}
        nominal = self._with_effects(trials[:1], ordered[:1], {})[0]
        # Relative to Housner's, which the contact's own impacts keep within 1 %.
        impact = acting.setdefault("restitution", library()["restitution"].nominal(nominal))
        impact["energy_ratio"] *= first.nuisances.energy_ratio
        trials = self._with_effects(trials, ordered, acting)
        logs: dict[int, TrialLog] = {}

        def keep(index: int, log: TrialLog | None) -> None:
            if log is not None:
                logs[index] = log

        result = run_batch(trials, keep_logs=False, on_trial=keep)
        judged, overturned = result.judged, result.overturned
        for i in range(len(trials)):
            if not judged[i]:
                raise SimulationError(
                    f"engine bullet: a trial ended with status {result['status'][i]} "
                    f"({result['message'][i] or 'no exception'}); change the scene"
                )
            yield _observed(bool(overturned[i]), float(result["peak_tilt"][i]), logs[i])

    def _trials(
        self, inputs: Sequence[TrialInput], nuisances: Nuisances, series_interval: float
    ) -> list[Trial]:
        from vsr2.scene import build_scene
        from vsr2.trial import Trial, rows_only

        scene = build_scene(self._nominal(nuisances))
        step = scene.engine.time_step
        output = rows_only(self._study.output, max(1, round(series_interval / step)))
        outcome = self._study.outcome
        stop = max(BULLET_ENGINE.stop, outcome.overturned_tilt)
        outcome = outcome.model_copy(update={"overturned_tilt": stop})
        return [
            Trial(
                scene=scene,
                motion=build_recorded_motion(
                    Record(f"m{i}", one.interval, displacement=one.displacement), step
                ),
                start=self._start(scene, one),
                name=f"m{i}",
                settling=self._study.settling,
                outcome=outcome,
                output=output,
            )
            for i, one in enumerate(inputs)
        ]

    def _with_effects(
        self,
        trials: Sequence[Trial],
        inputs: Sequence[TrialInput],
        drawn: Mapping[str, Mapping[str, float]],
    ) -> list[Trial]:
        """Trials with the study's effects and drawn ones, in one order of application."""
        seed = inputs[0].context.campaign_seed
        own_seed = np.random.SeedSequence([seed, _SCENE_EFFECTS]).generate_state(1)[0]
        with warnings.catch_warnings():
            # A drawn ratio at the end of its prior, times a nuisance, may lie beyond.
            warnings.simplefilter("ignore", EffectRangeWarning)
            given = [(own, int(own_seed)) for own in chosen(self._study.effects)]
            given += [(one, seed) for one in chosen(drawn)]
        given.sort(key=lambda pair: place(pair[0][0]))
        return with_effects(
            trials,
            [pair for pair, _ in given],
            relative_order=[one.context.order for one in inputs],
            sessions=[f"{one.context.session}" for one in inputs],
            seed=[own for _, own in given],
        )

    def _start(self, scene: Scene, one: TrialInput) -> Pose:
        """The scene's start turned about the block's vertical and shifted."""
        start = scene.rock.start
        half = 0.5 * one.yaw
        turned = quaternion_product(
            np.array([[0.0, 0.0, math.sin(half), math.cos(half)]]), np.array([start.orientation])
        )[0]
        x, y, z, w = (float(value) for value in turned)
        at = start.position
        return replace(
            start,
            position=(at[0] + one.offset[0], at[1] + one.offset[1], at[2]),
            orientation=(x, y, z, w),
        )

    def _nominal(self, nuisances: Nuisances) -> Study:
        study = self._study
        assert isinstance(study.rock, BoxRock)
        factors = (nuisances.width, nuisances.depth, nuisances.height)
        width, depth, height = (s * f for s, f in zip(study.rock.size, factors, strict=True))
        material = study.contact.rock
        material = material.model_copy(
            update={"lateral_friction": material.lateral_friction * nuisances.friction}
        )
        return study.model_copy(
            update={
                "rock": study.rock.model_copy(update={"size": (width, depth, height)}),
                "contact": study.contact.model_copy(update={"rock": material}),
            }
        )


def _observed(overturned: bool, peak_tilt: float, log: TrialLog) -> Response:
    kept = (log.time >= 0) & np.isfinite(log.state).all(axis=1)
    position, orientation = log.from_rest(kept)
    return Response(
        overturned,
        peak_tilt,
        log.time[kept],
        log.tilt[kept],
        position,
        orientation / np.linalg.norm(orientation, axis=1, keepdims=True),
    )
