"""A replay as one HTML file that needs no server."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from vsr2.results.atomic import write_text
from vsr2.view.drawing import FRAME_INTERVAL, Drawing, quiet_server, stop_server
from vsr2.view.replay import load_replay


def write_page(
    folder: str | os.PathLike[str], file: str | os.PathLike[str], *, trial: int | None = None
) -> Path:
    """Write the replay of one trial as a self-contained HTML page with play bar.

    Args:
        folder: result folder.
        file: the page; opens in any browser, from disk, without the internet.
        trial: index; default: the first that has a log.

    Returns:
        The page's path.

    Raises:
        ResultError: the trial cannot be shown, the file cannot be written, or viser is not
            installed.
    """
    path = Path(file)
    replay = load_replay(folder, trial)
    # viser records what it would send to a browser; none needs to be there.
    server = quiet_server("127.0.0.1", 8080)
    try:
        drawing = Drawing(server, replay)
        recording = server.get_scene_serializer()
        start, end = float(replay.time[0]), float(replay.time[-1])
        for time in np.arange(start, end, FRAME_INTERVAL)[1:]:
            recording.insert_sleep(FRAME_INTERVAL)
            drawing.show(float(time))
        recording.insert_sleep(FRAME_INTERVAL)
        drawing.show(end)
        page = recording.as_html()
    finally:
        stop_server(server)
    write_text(path, page)
    return path
