"""A rocking boulder as an animation: a scanned rock under a record that overturns it.

Runs one record of `configs/demo.yaml` and draws the rock from the side, the pedestal below it and
the tilt in time, as an animated WebP that browsers play. Run from the repository's root (half a
minute on one core):

    python studies/figure_boulder.py [--out docs/tutorial/boulder.webp]
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2 import load_study, run_batch
from vsr2.scene import build_scene
from vsr2.scene.rotation import rotate
from vsr2.view.replay import Replay

Array = NDArray[np.float64]

STUDY = "configs/demo.yaml"
RECORD = "synthetic_11.csv"
"""Rocks the boulder for four seconds, then overturns it along the shaking."""
SHOWN = 4.8
"""Length of the end of the trial that is shown [s]."""
FRAMES = 15
"""In a second of the trial, and of the animation."""
RISE = np.radians(12.0)
"""Of the camera, above the horizontal [rad]."""
LIGHT = np.array([-0.5, -0.7, 0.6]) / np.linalg.norm([-0.5, -0.7, 0.6])
BROWN, STONE, INK, BLUE = "#ba8c63", "#c9ced4", "#1c2430", "#1f6f8b"
HALF_WIDTH = 1.1
"""Of the picture, in heights of the rock."""


def overturning() -> Replay:
    """The trial, ready to be drawn."""
    study = load_study(STUDY, overrides=[f"motion.pattern={RECORD}", "output.log_every=5"])
    [log] = run_batch(study, threads=1).logs
    scene = build_scene(study)
    assert log is not None
    assert scene.rock.surface is not None
    return Replay(RECORD, log, scene.rock.surface, scene.rock.surface)


def seen(points: Array) -> tuple[Array, Array]:
    """Points as the camera sees them from the side: picture (n, 2), and depth (n,)."""
    x, y, z = np.moveaxis(points, -1, 0)
    up = z * np.cos(RISE) + y * np.sin(RISE)
    depth = y * np.cos(RISE) - z * np.sin(RISE)
    return np.stack([x, up], axis=-1), depth


def rock_polygons(replay: Replay, row: int) -> tuple[Array, Array]:
    """Triangles of the rock that face the camera, the farthest first, and their shade in [0, 1]."""
    vertices = replay.rock.vertices
    turn = np.broadcast_to(replay.rock_orientation[row], (len(vertices), 4))
    corners = (rotate(turn, vertices) + replay.rock_position[row])[replay.rock.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    flat, depth = seen(corners)
    away = normal @ np.array([0.0, np.cos(RISE), -np.sin(RISE)])
    kept = np.flatnonzero(away < 0)
    order = kept[np.argsort(-depth[kept].mean(axis=1), kind="stable")]
    return flat[order], np.clip(0.55 + 0.45 * normal[order] @ LIGHT, 0.15, 1.0)


def frames(replay: Replay) -> list[bytes]:
    """Pictures of the end of the trial, as PNG."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure

    end = float(replay.time[-1])
    times = np.arange(end - SHOWN, end, 1 / FRAMES)
    low, high = replay.rock.vertices.min(axis=0), replay.rock.vertices.max(axis=0)
    size = float((high - low).max())
    start = replay.row(0.0)
    foot = float(rock_polygons(replay, start)[0][..., 1].min())
    middle = float(replay.log.position[start, 0])
    out = []
    for time in times:
        row = replay.row(float(time))
        figure = Figure(figsize=(4.2, 4.4), dpi=80)
        panel, below = figure.subplots(2, 1, height_ratios=(4, 1))
        figure.subplots_adjust(left=0.13, right=0.98, top=0.99, bottom=0.11, hspace=0.08)
        moved = replay.log.column("pedestal_position")[row]
        panel.axhspan(foot - size, foot + 0.02 * size, color=STONE)
        for k in range(-12, 13):
            panel.axvline(middle + moved + 0.25 * k * size, 0, 0.12, color="#a4abb4", lw=1)
        flat, shade = rock_polygons(replay, row)
        colours = np.outer(shade, to_rgb(BROWN))
        panel.add_collection(
            PolyCollection(list(flat), facecolors=colours, edgecolors=colours, lw=0.3)
        )
        panel.set(
            xlim=(middle - HALF_WIDTH * size, middle + HALF_WIDTH * size),
            ylim=(foot - 0.2 * size, foot + 1.5 * size),
            aspect="equal",
        )
        panel.axis("off")
        shown = replay.time >= times[0]
        below.plot(replay.time[shown], np.degrees(replay.tilt[shown]), color="0.8", lw=1)
        past = shown & (replay.time <= time)
        below.plot(replay.time[past], np.degrees(replay.tilt[past]), color=BLUE, lw=1.5)
        below.set(xlabel="time [s]", ylabel="tilt [deg]", xlim=(times[0], end), ylim=(-3, 83))
        below.tick_params(labelsize=7)
        below.xaxis.label.set_size(8)
        below.yaxis.label.set_size(8)
        below.spines[["top", "right"]].set_visible(False)
        file = io.BytesIO()
        figure.savefig(file, format="png", facecolor="white")
        out.append(file.getvalue())
    return out


def main() -> None:
    """Write the animation."""
    from PIL import Image

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/tutorial/boulder.webp"))
    out = parser.parse_args().out
    first, *others = (Image.open(io.BytesIO(one)).convert("RGB") for one in frames(overturning()))
    durations = [round(1000 / FRAMES)] * len(others) + [1500]
    first.save(
        out, save_all=True, append_images=others, duration=durations, loop=0, quality=40, method=4
    )
    print(f"{out}: {len(durations)} pictures, {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
