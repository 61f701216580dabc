"""A live view of a simulation that is stepped from Python."""

from __future__ import annotations

import numpy as np

from vsr2.errors import SimulationError
from vsr2.results import CONTACT_COLUMNS, STATE_COLUMNS, TrialLog
from vsr2.results.trial_log import (
    ANGULAR_VELOCITY,
    CONTACT_TIME,
    ORIENTATION,
    POSITION,
    ROCK_POINT,
    VELOCITY,
)
from vsr2.scene.rotation import quaternion_from_matrix
from vsr2.simulation import Simulation
from vsr2.view.drawing import Drawing, Served
from vsr2.view.replay import Replay


class LiveView(Served):
    """Serves the present state of a simulation to any number of browsers.

    Tilt is measured from the pose that the rock had when the view was made. As a context manager it
    stops at the end.

    Args:
        simulation: with a rock on it; call :meth:`update` after steps that are to be seen.
        host: address to listen on.
        port: to listen on; the next free one is taken where it is in use.

    Raises:
        SimulationError: there is no rock, or its bodies have no surface.
        ResultError: viser is not installed, or the address cannot be listened on.
    """

    def __init__(
        self, simulation: Simulation, *, host: str = "127.0.0.1", port: int = 8080
    ) -> None:
        self._simulation = simulation
        self._settled = simulation.state
        first = self._replay()
        super().__init__(host, port)
        self._drawing = Drawing(self._server, first)

    def update(self) -> None:
        """Draw the simulation as it is now.

        Raises:
            SimulationError: the rock was taken away.
        """
        self._drawing.replay = self._replay()
        self._drawing.show(self._simulation.time)

    def _replay(self) -> Replay:
        """The present state as a replay of one row."""
        now, scene = self._simulation.state, self._simulation.scene
        rock, pedestal = scene.rock.surface, scene.pedestal_surface
        if rock is None or pedestal is None:
            raise SimulationError("live view: a body has no surface; build the scene from a study")
        row = np.zeros(len(STATE_COLUMNS))
        row[STATE_COLUMNS.index("time")] = now.time
        row[STATE_COLUMNS.index("pedestal_position")] = now.pedestal_position
        row[STATE_COLUMNS.index("pedestal_velocity")] = now.pedestal_velocity
        row[POSITION], row[ORIENTATION] = now.position, now.body_orientation
        row[VELOCITY], row[ANGULAR_VELOCITY] = now.velocity, now.angular_velocity
        found = self._simulation.contacts()
        contacts = np.zeros((len(found), len(CONTACT_COLUMNS)))
        contacts[:, CONTACT_TIME] = now.time
        for one, contact in zip(contacts, found, strict=True):
            one[ROCK_POINT] = contact["rock_point"]
        log = TrialLog(
            state=row[None, :],
            contacts=contacts,
            settled_position=self._settled.position,
            settled_orientation=self._settled.body_orientation,
            foot=np.zeros(3),
            mass_center=scene.rock.mass.mass_center,
            principal_axes=np.array(quaternion_from_matrix(scene.rock.mass.principal_axes)),
            excursions=np.array([self._simulation.excursion]),
            pivot=np.array([0.0, 0.0, scene.pitch_pivot]),
        )
        return Replay("live", log, rock, pedestal)
