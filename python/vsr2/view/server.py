"""The interactive replay: a web server on the machine that holds the result."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import ResultError
from vsr2.results import load_result, logged_trials
from vsr2.view.drawing import FRAME_INTERVAL, Drawing, Served
from vsr2.view.replay import Replay, choose_trial, load_replay, trial_title

Array = NDArray[np.float64]

BLUE, ORANGE, BLACK = "#0072B2", "#E69F00", "#000000"
CURSOR_STEPS = 100
"""Steps of the time cursor along its plot; more would be sent but not seen."""

SPEEDS = {f"{speed:g} x": speed for speed in (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)}
LEAST_TILT = 0.1
"""Upper end of the tilt's axis at least: ticks of less would look equal [deg]."""
PLOT_ROWS = 1000
"""Points of the tilt curve; more would not be seen."""


class ReplayServer(Served):
    """Serves a 3-D replay to any number of browsers until it is closed.

    Time slider, play and pause, speed, tilt and slip readout, choice of trial. It works without a
    screen and without the internet on this machine.

    Args:
        folder: result folder.
        trial: shown first; default: the first that has a log.
        host: address to listen on; `0.0.0.0`: all, so that others on the network can watch.
        port: to listen on; the next free one is taken where it is in use.

    Raises:
        ResultError: the folder cannot be read, the trial has no log, the address cannot be
            listened on, or viser is not installed.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        trial: int | None = None,
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        self._folder = Path(folder)
        self._result = load_result(self._folder, logs=False)
        self._logged = logged_trials(self._folder)
        first = choose_trial(self._folder, self._result, trial)
        replay = load_replay(self._folder, first)
        super().__init__(host, port)
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._playing = False
        self._loading = False
        self._drawing = Drawing(self._server, replay)
        self._add_controls(replay, first)
        self._player = threading.Thread(target=self._play, name="replay", daemon=True)
        self._player.start()

    @property
    def time(self) -> float:
        """Time shown [s]."""
        return float(self._slider.value)

    def show(self, time: float) -> None:
        """Draw the state nearest to `time` [s]."""
        self._slider.value = float(time)

    def wait(self) -> None:
        """Serve until :meth:`close` is called or Ctrl-C is pressed."""
        # In slices, because a wait without end would not notice Ctrl-C everywhere.
        while not self._stop.wait(0.5):
            pass

    def close(self) -> None:
        """Stop serving."""
        if not self._stop.is_set():
            self._stop.set()
            self._player.join(timeout=5.0)
            super().close()

    def _add_controls(self, replay: Replay, first: int) -> None:
        gui = self._server.gui
        self._options = {trial_title(self._result, i): i for i in self._logged}
        titles = {i: title for title, i in self._options.items()}
        self._trial = gui.add_dropdown(
            "Trial", options=tuple(self._options), initial_value=titles[first]
        )
        start, end, interval = _time_range(replay)
        self._slider = gui.add_slider(
            "Time [s]", min=start, max=end, step=interval, initial_value=start
        )
        self._button = gui.add_button("Play")
        self._speed = gui.add_dropdown("Speed", options=tuple(SPEEDS), initial_value="1 x")
        self._loop = gui.add_checkbox("Loop", initial_value=False)
        # A panel of its own starts folded on a phone, where it would lie over the rock.
        numbers = gui.add_panel()
        numbers.dock_below(gui.main_panel)
        with numbers.add_tab("Response"):
            self._add_response(replay, start)
        self._slider.on_update(lambda _: self._refresh())
        self._button.on_click(lambda _: self._toggle())
        self._trial.on_update(lambda _: self._load(self._options[str(self._trial.value)]))
        self._refresh()

    def _add_response(self, replay: Replay, start: float) -> None:
        """What is read off and plotted, from `start` on [s]."""
        gui = self._server.gui
        self._cursor, self._cursor_step = start, _cursor_step(replay)
        self._plot = gui.add_uplot(
            data=_curves(replay, start),
            series=(
                {"label": "time [s]"},
                {"label": "tilt [deg]", "stroke": BLUE, "width": 2},
                {"label": "table [m]", "stroke": ORANGE, "width": 1, "scale": "table"},
                {"label": "now", "stroke": BLACK, "width": 1},
            ),
            scales={
                "x": {"time": False, "auto": True},
                "y": {"auto": True},
                "table": {"auto": True},
            },
            axes=(
                {"label": "time [s]"},
                {"label": "tilt [deg]", "stroke": BLUE},
                {"label": "table [m]", "stroke": ORANGE, "scale": "table", "side": 1},
            ),
            aspect=1.6,
            padding=(12, 0, 0, 0),  # [px], so that the highest tick is not cut
        )
        self._tilt = gui.add_text("Tilt [deg]", initial_value="", disabled=True)
        self._slip = gui.add_text("Slip x, y [mm]", initial_value="", disabled=True)
        self._pedestal = gui.add_text("Pedestal [m]", initial_value="", disabled=True)
        self._force = gui.add_text("Force, up [kN]", initial_value="", disabled=True)

    def _toggle(self) -> None:
        with self._lock:
            if not self._playing and self.time >= self._slider.max - 1e-9:
                self.show(self._slider.min)
            self._set_playing(not self._playing)

    def _set_playing(self, playing: bool) -> None:
        self._playing = playing
        self._button.label = "Pause" if playing else "Play"

    def _refresh(self) -> None:
        with self._lock:
            if self._loading:
                return
            replay = self._drawing.replay
            row = self._drawing.show(self.time)
            slip = 1e3 * replay.log.slip[row]
            self._tilt.value = _rounded(float(np.degrees(replay.tilt[row])), 2)
            self._slip.value = f"{_rounded(slip[0], 1)}, {_rounded(slip[1], 1)}"
            self._pedestal.value = _rounded(replay.log.column("pedestal_position")[row], 4)
            self._force.value = _rounded(replay.contact_forces(self.time)[:, 2].sum() / 1e3, 2)
            if abs(self.time - self._cursor) >= self._cursor_step:
                self._cursor = self.time
                self._plot.data = _curves(replay, self.time)

    def _load(self, trial: int) -> None:
        try:
            replay = load_replay(self._folder, trial)
        except ResultError as error:
            self._server.add_notification("Cannot be shown", str(error), color="red")
            return
        with self._lock:
            self._loading = True
            self._set_playing(False)
            self._server.scene.reset()
            self._drawing = Drawing(self._server, replay)
            start, self._slider.max, self._slider.step = _time_range(replay)
            self._slider.min = start
            self._slider.value = start
            self._cursor_step = _cursor_step(replay)
            self._plot.data = _curves(replay, start)
            self._loading = False
            self._refresh()

    def _play(self) -> None:
        last = time.monotonic()
        while not self._stop.wait(FRAME_INTERVAL):
            now = time.monotonic()
            passed, last = now - last, now
            with self._lock:
                if not self._playing:
                    continue
                # From the slider, so that it can be dragged while it plays.
                moment = self.time + passed * SPEEDS[str(self._speed.value)]
                if moment >= self._slider.max:
                    moment = self._slider.min if self._loop.value else self._slider.max
                    self._set_playing(bool(self._loop.value))
                self.show(moment)


def _time_range(replay: Replay) -> tuple[float, float, float]:
    """First and last time and interval of the rows [s]; the last is after the first."""
    start, end = float(replay.time[0]), float(replay.time[-1])
    interval = float(np.median(np.diff(replay.time))) if len(replay.time) > 1 else 1e-3
    return start, max(end, start + interval), interval


def _curves(replay: Replay, now: float) -> tuple[Array, Array, Array, Array]:
    """Time [s], tilt [deg], the table's position [m], and a spike of the tilt's height at `now`."""
    every = max(1, len(replay.time) // PLOT_ROWS)
    tilt = np.degrees(replay.tilt[::every])
    # A spike on a line of zeros: a gap, which is NaN, would take the plot's scale with it.
    cursor = np.zeros(len(tilt))
    cursor[replay.row(now) // every] = max(float(tilt.max()), LEAST_TILT)
    table = replay.log.column("pedestal_position")[::every]
    return replay.time[::every].copy(), tilt, table.copy(), cursor


def _cursor_step(replay: Replay) -> float:
    """Time that passes before the cursor is drawn again [s]; all curves are sent with it."""
    start, end, _ = _time_range(replay)
    return (end - start) / CURSOR_STEPS


def _rounded(value: float, digits: int) -> str:
    """With so many decimals, and 0 without a sign."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"
