"""The engine `mujoco`: a scene's body in the independent simulation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from vsr2.blind.custodian.engine import TrialInput
from vsr2.blind.form.pack_settings import EngineName
from vsr2.blind.mujoco import (
    EFFECTS,
    NOMINAL,
    Body,
    ContactModel,
    Drawable,
    Response,
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
from vsr2.motion import STANDARD_GRAVITY


class MujocoEngine:
    """Trials of a study's rock and friction on MuJoCo; nothing else of the study is used.

    Args:
        study: of the nominal scene.
        contact: how MuJoCo solves contacts.

    Raises:
        BlindError: MuJoCo is missing; the study has effects; or the rock is no block and no mesh
            that stands as its file has it.
    """

    name = EngineName.MUJOCO.value

    def __init__(self, study: Study, contact: ContactModel = NOMINAL) -> None:
        for name, values in study.effects.items():
            raise BlindError(
                f"study {study.name!r}: effects.{name} is {values}, but the engine mujoco takes no "
                "effects of the scene; leave them out, or --engine bullet"
            )
        self._contact = contact
        try:
            import mujoco
        except ImportError:
            raise BlindError(
                "engine mujoco: the package mujoco is not installed; pip install 'vsr2[blind]'"
            ) from None
        self._version = str(mujoco.__version__)
        rock = study.rock
        self._size: tuple[float, float, float] | None = None
        if isinstance(rock, BoxRock):
            self._size = rock.size
            self._density = rock.density or (rock.mass or 0.0) / math.prod(rock.size)
            self._nominal = block(*rock.size, self._density)
        elif isinstance(rock, MeshRock):
            upright = rock.start.mode == "yaw" and rock.start.base_orientation == (0, 0, 0, 1)
            if not upright or rock.file.suffix.lower() != ".obj":
                raise BlindError(
                    f"engine mujoco: {rock.file} must be an OBJ that stands as it is; turn the "
                    "mesh upright and start it with `mode: yaw`"
                )
            try:
                self._nominal = _scaled(read_hull(rock.file, 1.0), (rock.scale,) * 3)
            except (OSError, ValueError) as error:
                raise BlindError(f"engine mujoco: {rock.file}: {error}") from None
            mass = rock.mass or (rock.density or 0.0) * self._nominal.mass
            inertia = self._nominal.inertia * (mass / self._nominal.mass)
            self._nominal = replace(self._nominal, mass=mass, inertia=inertia)
        else:
            raise BlindError(
                f"study {study.name!r}: rock.shape is {rock.shape!r}, but the engine mujoco takes "
                "box or mesh; give such a scene"
            )
        stated = study.contact
        self._friction = stated.rock.lateral_friction * stated.pedestal.lateral_friction

    @property
    def versions(self) -> Mapping[str, str]:
        """Of what simulates."""
        return {"mujoco": self._version}

    @property
    def static_acceleration(self) -> float:
        """Acceleration of uplift, g b / h [m/s^2]."""
        return STANDARD_GRAVITY * math.tan(self._nominal.slenderness_angle)

    @property
    def effects(self) -> Mapping[str, Drawable]:
        """All that the independent simulation has."""
        return EFFECTS

    def run(self, inputs: Iterable[TrialInput], series_interval: float) -> Iterator[Response]:
        """Simulate trials, in their order."""
        for one in inputs:
            nuisances = one.nuisances
            factors = (nuisances.width, nuisances.depth, nuisances.height)
            if self._size is not None:
                width, depth, height = (s * f for s, f in zip(self._size, factors, strict=True))
                body = block(width, depth, height, self._density)
            else:
                body = _scaled(self._nominal, factors)
            situation = Situation(
                body=body,
                table=TableMotion(one.interval, one.displacement),
                friction=self._friction * nuisances.friction,
                impact_energy_ratio=nuisances.energy_ratio,
                yaw=one.yaw,
                offset=one.offset,
                contact=self._contact,
            )
            acting = with_effects(situation, one.effects, one.context)
            response = run_trial(acting, series_interval=series_interval)
            yield observe(response, one.effects, one.context)


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
