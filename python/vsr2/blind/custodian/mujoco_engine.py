"""The engine `mujoco`: a scene's body in the independent simulation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Literal

import numpy as np

from vsr2.blind.custodian.shake import Drawable, Observed, Shake, Strength
from vsr2.blind.mujoco import (
    EFFECTS,
    Body,
    Place,
    Situation,
    TableMotion,
    block,
    observe,
    read_hull,
    run_trial,
    with_effects,
)
from vsr2.config.study import BoxRock, MeshRock, Study
from vsr2.errors import BlindError


class MujocoEngine:
    """Trials of a study's rock and friction on MuJoCo; nothing else of the study is used.

    Raises:
        BlindError: MuJoCo is missing; or the rock is no block and no mesh that stands as its file
            has it.
    """

    def __init__(self, study: Study) -> None:
        try:
            import mujoco
        except ImportError:
            raise BlindError(
                "engine mujoco: the package mujoco is not installed; pip install 'vsr2[blind]'"
            ) from None
        self._version = str(mujoco.__version__)
        rock = study.rock
        if isinstance(rock, BoxRock):
            width, depth, height = rock.size
            self._size: tuple[float, float, float] | None = (width, depth, height)
            density = rock.density or (rock.mass or 0.0) / (width * depth * height)
            self._nominal = block(width, depth, height, density)
            self._density = density
        elif isinstance(rock, MeshRock):
            upright = rock.start.mode == "yaw" and rock.start.base_orientation == (0, 0, 0, 1)
            if not upright or rock.file.suffix.lower() != ".obj":
                raise BlindError(
                    f"engine mujoco: {rock.file} must be an OBJ that stands as it is; turn the "
                    "mesh upright and start it with `mode: yaw`"
                )
            self._size = None
            try:
                self._nominal = _scaled(read_hull(rock.file, 1.0), (rock.scale,) * 3)
            except (OSError, ValueError) as error:
                raise BlindError(f"engine mujoco: {rock.file}: {error}") from None
            mass = rock.mass or (rock.density or 0.0) * self._nominal.mass
            factor = mass / self._nominal.mass
            self._nominal = replace(
                self._nominal, mass=mass, inertia=self._nominal.inertia * factor
            )
        else:
            raise BlindError(
                f"study {study.name!r}: rock.shape is {rock.shape!r}, but the engine mujoco takes "
                "box or mesh; give such a scene"
            )
        contact = study.contact
        self._friction = contact.rock.lateral_friction * contact.pedestal.lateral_friction

    @property
    def name(self) -> Literal["mujoco"]:
        """Of the engine."""
        return "mujoco"

    @property
    def versions(self) -> Mapping[str, str]:
        """Of what simulates."""
        return {"mujoco": self._version}

    @property
    def static_pga(self) -> float:
        """Acceleration of uplift, g b / h [m/s^2]."""
        return 9.80665 * math.tan(self._nominal.slenderness_angle)

    @cached_property
    def effects(self) -> Mapping[str, Drawable]:
        """All that the independent simulation has."""
        out = {}
        for name, effect in EFFECTS.items():
            own = effect.strength
            out[name] = Drawable(
                name,
                Strength(
                    own.name, own.unit, own.null, own.low, own.high, own.scale == "reciprocal"
                ),
                tuple((p.name, p.low, p.high) for p in effect.parameters[1:]),
                effect.drifts,
            )
        return out

    def run(self, shakes: Iterable[Shake], series_interval: float) -> Iterator[Observed]:
        """Simulate trials, in their order."""
        for shake in shakes:
            yield self._one(shake, series_interval)

    def _one(self, shake: Shake, series_interval: float) -> Observed:
        nuisances = shake.nuisances
        factors = (nuisances.width, nuisances.depth, nuisances.height)
        if self._size is not None:
            size = [s * f for s, f in zip(self._size, factors, strict=True)]
            body = block(size[0], size[1], size[2], self._density)
        else:
            body = _scaled(self._nominal, factors)
        situation = Situation(
            body=body,
            table=TableMotion(shake.interval, shake.displacement),
            friction=self._friction * nuisances.friction,
            impact_energy_ratio=nuisances.energy_ratio,
            yaw=shake.yaw,
            offset=shake.offset,
        )
        place = Place(
            shake.order, shake.session, shake.sessions, shake.campaign_seed, shake.trial_seed
        )
        response = run_trial(
            with_effects(situation, shake.effects, place), series_interval=series_interval
        )
        seen = observe(response, shake.effects, place)
        return Observed(
            seen.overturned,
            seen.peak_tilt,
            seen.time,
            seen.tilt,
            seen.position,
            seen.orientation,
        )


def _scaled(body: Body, factors: tuple[float, ...]) -> Body:
    """The body stretched along its axes, its density kept; second moments scale with it."""
    f = np.array(factors)
    volume = float(f.prod())
    inertia = body.inertia
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    second = volume * second * np.outer(f, f)
    return replace(
        body,
        points=body.points * f,
        mass=body.mass * volume,
        center=body.center * f,
        inertia=np.trace(second) * np.eye(3) - second,
    )
