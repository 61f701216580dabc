"""The scene of a replay in viser: what is drawn, and where at a time."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import ResultError
from vsr2.scene import Triangles
from vsr2.view.guard import own_requests_only
from vsr2.view.replay import Replay

ROCK_COLOR = (186, 140, 99)
PEDESTAL_COLOR = (140, 148, 158)
CONTACT_COLOR = (220, 40, 30)
FRAME_INTERVAL = 1.0 / 30.0
"""Between two states of a replay that plays, in a server and in a page [s]."""
PORTS_TRIED = 100
"""From the one that was asked for, until one is free."""
USUAL_ARROW, LONGEST_ARROW = 0.5, 1.5
"""Lengths of arrows over the rock's longest edge: of the usual contact force, and at most."""

Array = NDArray[np.float64]


def import_viser() -> ModuleType:
    """The library that draws.

    Raises:
        ResultError: it is not installed; names the remedy.
    """
    try:
        import viser
    except ImportError as error:
        raise ResultError(
            "the 3-D replay needs the package viser; install it with: pip install vsr2[view]"
        ) from error
    module: ModuleType = viser
    return module


def quiet_server(host: str, port: int) -> Any:
    """A viser server without its banner and without the button that shares it on the internet.

    Args:
        host: address to listen on.
        port: to listen on, or the next free one.

    Raises:
        ResultError: viser is not installed, or the address cannot be listened on.
    """
    viser = import_viser()
    port = _free_port(host, port)
    with _without_banner(), own_requests_only(host):
        server = viser.ViserServer(host=host, port=port, label="VSR2", verbose=False)
    server.gui.configure_theme(control_width="medium", show_share_button=False)
    server.gui.main_panel.dock_right()
    return server


def _free_port(host: str, first: int) -> int:
    # Looked for here, because viser waits for ever where it cannot listen.
    if not 0 < first < 65536:
        raise ResultError(f"port {first} does not exist; choose one from 1024 to 65535")
    try:
        family = socket.getaddrinfo(host, first, type=socket.SOCK_STREAM)[0][0]
    except (OSError, UnicodeError) as error:
        raise ResultError(
            f"host {host!r}: is no address of this machine ({error}); use 127.0.0.1 for this "
            "machine alone, 0.0.0.0 for all its networks"
        ) from error
    for port in range(first, min(first + PORTS_TRIED, 65536)):
        try:
            socket.create_server((host, port), family=family).close()
        except OSError as error:
            problem = error
        else:
            return port
    raise ResultError(
        f"{host}: none of the ports {first} to {port} can be listened on ({problem}); choose "
        "another port, or 127.0.0.1 or 0.0.0.0 as host"
    )


def stop_server(server: Any) -> None:
    """Stop a server of :func:`quiet_server`."""
    with _without_banner():
        server.stop()


class Served:
    """What serves drawings to any number of browsers; as a context manager it stops at the end.

    Args:
        host: as of :func:`quiet_server`.
        port: likewise.
    """

    def __init__(self, host: str, port: int) -> None:
        self._server, self._host = quiet_server(host, port), host

    @property
    def port(self) -> int:
        """Port that is listened on."""
        return int(self._server.get_port())

    @property
    def url(self) -> str:
        """Address to open in a browser on this machine."""
        everywhere = self._host in ("0.0.0.0", "::", "")
        return f"http://{'127.0.0.1' if everywhere else self._host}:{self.port}"

    def close(self) -> None:
        """Stop serving."""
        stop_server(self._server)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


@contextmanager
def _without_banner() -> Iterator[None]:
    """Keep viser quiet: it prints addresses and notes through rich whatever `verbose` says."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


class Drawing:
    """Rock, pedestal, ground grid, contacts and their normal forces of one trial in a viser server.

    Args:
        server: viser's server.
        replay: the trial.
    """

    def __init__(self, server: Any, replay: Replay) -> None:
        self.replay = replay
        self._server = server
        # The longest edge of the rock's bounding box [m].
        size = float(np.ptp(replay.rock.vertices, axis=0).max())
        low, high = replay.pedestal.vertices.min(axis=0), replay.pedestal.vertices.max(axis=0)
        scene = server.scene
        scene.world_axes.visible = False
        cell = _round_length(size)
        margin = 4.0 * cell
        scene.add_grid(
            "/ground",
            width=float(high[0] - low[0]) + 2 * margin,
            height=float(high[1] - low[1]) + 2 * margin,
            cell_size=cell,
            section_size=5 * cell,
            plane_color=(235, 235, 230),
            plane_opacity=1.0,
            position=(*(0.5 * (low + high))[:2], float(low[2])),
        )
        self._pedestal = self._add_body("/pedestal", replay.pedestal, PEDESTAL_COLOR)
        self._rock = self._add_body("/rock", replay.rock, ROCK_COLOR)
        if np.unique(replay.pedestal.vertices[:, 2]).size == 2:
            # A plain top shows no motion: lines that move with it do.
            scene.add_grid(
                "/pedestal/lines",
                width=float(high[0] - low[0]),
                height=float(high[1] - low[1]),
                cell_size=cell,
                section_size=5 * cell,
                cell_color=(110, 116, 124),
                section_color=(80, 86, 94),
                position=(*(0.5 * (low + high))[:2], float(high[2]) + 1e-3 * size),
            )
        self._contacts = scene.add_point_cloud(
            "/contacts",
            np.zeros((1, 3), dtype=np.float32),
            colors=CONTACT_COLOR,
            point_size=0.04 * size,
            point_shape="circle",
            precision="float32",
            visible=False,
        )
        self._size = size
        self._forces = scene.add_arrows(
            "/forces",
            np.zeros((1, 2, 3), dtype=np.float32),
            colors=CONTACT_COLOR,
            shaft_radius=0.008 * size,
            head_radius=0.02 * size,
            head_length=0.04 * size,
            visible=False,
        )
        self._label = scene.add_label("/label", "", anchor="bottom-center")
        self._label_height = 0.8 * size
        self._aim(size)
        self.show(float(replay.time[0]))

    def _add_body(self, name: str, surface: Triangles, color: tuple[int, int, int]) -> Any:
        frame = self._server.scene.add_frame(name, show_axes=False)
        self._server.scene.add_mesh_simple(
            f"{name}/surface",
            surface.vertices.astype(np.float32),
            surface.faces.astype(np.uint32),
            color=color,
            flat_shading=True,
            side="double",
        )
        return frame

    def _aim(self, size: float) -> None:
        """Look along y, across the shaking, from slightly above and aside."""
        target = self.replay.log.position[0]
        camera = self._server.initial_camera
        camera.position = target + size * np.array([0.7, -2.4, 0.9])
        camera.look_at = target
        camera.fov = float(np.radians(50.0))
        camera.near = 0.01 * size
        camera.far = 1000.0 * size

    def show(self, time: float) -> int:
        """Draw the state nearest to `time` [s]; returns its row in the log."""
        replay = self.replay
        row = replay.row(time)
        points = replay.contacts(float(replay.time[row]))
        center = replay.log.position[row]
        with self._server.atomic():
            self._pedestal.position = replay.pedestal_position[row]
            self._pedestal.wxyz = np.roll(replay.pedestal_orientation[row], 1)
            self._rock.position = replay.rock_position[row]
            self._rock.wxyz = np.roll(replay.rock_orientation[row], 1)
            if len(points):
                self._contacts.points = points.astype(np.float32)
            self._contacts.visible = bool(len(points))
            self._show_forces(points, replay.contact_forces(float(replay.time[row])))
            self._label.position = (*center[:2], center[2] + self._label_height)
            self._label.text = (
                f"t = {replay.time[row]:.2f} s   tilt = {np.degrees(replay.tilt[row]):.1f} deg"
            )
        return row

    def _show_forces(self, points: Array, forces: Array) -> None:
        """Arrows up from the contacts; the usual force is `USUAL_ARROW` of the rock long."""
        usual = self.replay.usual_force
        shown = bool(len(points)) and usual > 0
        if shown:
            arrows = USUAL_ARROW * self._size / usual * forces
            length = np.linalg.norm(arrows, axis=1, keepdims=True)
            # An impact is hundreds of times as strong as the weight.
            arrows *= np.minimum(1.0, LONGEST_ARROW * self._size / np.maximum(length, 1e-12))
            ends = np.stack([points, points + arrows], axis=1)
            self._forces.points = ends.astype(np.float32)
        self._forces.visible = shown


def _round_length(size: float) -> float:
    """A tenth to a quarter of `size`, as 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(size / 4))
    return float(power * max(f for f in (1.0, 2.0, 5.0) if f * power <= size / 4 * (1 + 1e-9)))
