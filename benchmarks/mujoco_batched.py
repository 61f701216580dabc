"""MJX and MuJoCo Warp on the CPU: all rocks of a batch step together, in single precision.

Both take MuJoCo's own model, settled rock and forces (mujoco_rock.py). Compilation is not timed, so
a batch is compiled first and run afterwards. A step of theirs costs several times as much as
MuJoCo's, so benchmarks run a window of each motion.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mujoco_rock import FULL, MujocoRock

Array = NDArray[np.float64]


class JaxBatch:
    """A batch in MJX, compiled.

    Args:
        rock: settled.
        forces: generalised forces on every rock, shape (rocks, steps, 6).
    """

    def __init__(self, rock: MujocoRock, forces: Array) -> None:
        import jax
        from mujoco import mjx

        model = mjx.put_model(rock.model)

        def shaken(data: Any, force: Any) -> Any:
            def step(data: Any, force: Any) -> tuple[Any, None]:
                return mjx.step(model, data.replace(qfrc_applied=force)), None

            return jax.lax.scan(step, data, force)[0].qpos

        self._data = mjx.put_data(rock.model, started(rock))
        self._forces = jax.numpy.asarray(forces, dtype=jax.numpy.float32)
        together = jax.jit(jax.vmap(shaken, in_axes=(None, 0)))
        self._run = together.lower(self._data, self._forces).compile()

    def run(self) -> Array:
        """Positions at the end, shape (rocks, 7)."""
        return np.asarray(self._run(self._data, self._forces), dtype=np.float64)


class WarpBatch:
    """A batch in MuJoCo Warp on its device `cpu`, compiled.

    Args:
        rock: settled.
        forces: generalised forces on every rock, shape (rocks, steps, 6).
    """

    def __init__(self, rock: MujocoRock, forces: Array) -> None:
        import warp

        warp.config.quiet = True
        self._forces = np.ascontiguousarray(np.swapaxes(forces, 0, 1), dtype=np.float32)
        self._rock = rock
        self._stepped(1)

    def run(self) -> Array:
        """Positions at the end, shape (rocks, 7)."""
        return self._stepped(len(self._forces))

    def _stepped(self, steps: int) -> Array:
        import mujoco_warp
        import warp

        rock, rocks = self._rock, self._forces.shape[1]
        with warp.ScopedDevice("cpu"):
            model = mujoco_warp.put_model(rock.model)
            data = mujoco_warp.put_data(
                rock.model, started(rock), nworld=rocks, nconmax=16, njmax=64
            )
            for force in self._forces[:steps]:
                data.qfrc_applied.assign(force)
                mujoco_warp.step(model, data)
            return np.asarray(data.qpos.numpy(), dtype=np.float64)


def started(rock: MujocoRock) -> Any:
    """MuJoCo's data of the settled rock, with its contacts."""
    data = mujoco.MjData(rock.model)
    mujoco.mj_setState(rock.model, data, rock.rest, FULL)
    mujoco.mj_forward(rock.model, data)
    return data


def stepped_by_mujoco(rock: MujocoRock, forces: Array) -> Array:
    """What :meth:`JaxBatch.run` gives, by MuJoCo itself, shape (rocks, 7)."""
    ends = []
    for part in forces:
        data = started(rock)
        for force in part:
            data.qfrc_applied[:] = force
            mujoco.mj_step(rock.model, data)
        ends.append(data.qpos.copy())
    return np.array(ends)
