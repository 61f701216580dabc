"""Display meshes of rock and pedestal, kept with a result so that it can be shown anywhere."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from vsr2.errors import ResultError
from vsr2.results.arrays import read_arrays, write_arrays
from vsr2.results.atomic import make_folder
from vsr2.results.result_folder import MODEL_FOLDER
from vsr2.scene import Triangles

ROCK_FILE = "rock.npz"
PEDESTAL_FILE = "pedestal.npz"


def save_models(
    folder: str | os.PathLike[str], rock_surface: Triangles, pedestal_surface: Triangles
) -> None:
    """Keep the display meshes in a result folder, vertex by vertex.

    Args:
        folder: of the result, made ready by :func:`vsr2.results.result_folder.prepare_folder`.
        rock_surface: in the rock's model frame M [m].
        pedestal_surface: in the world, the pedestal at its start [m].

    Raises:
        ResultError: a file cannot be written.
    """
    path = Path(folder) / MODEL_FOLDER
    make_folder(path)
    for name, surface in ((ROCK_FILE, rock_surface), (PEDESTAL_FILE, pedestal_surface)):
        write_arrays(
            path / name,
            {
                "vertices": np.asarray(surface.vertices, dtype=np.float64),
                "faces": np.asarray(surface.faces, dtype=np.int32),
            },
        )


def load_models(folder: str | os.PathLike[str]) -> tuple[Triangles, Triangles]:
    """The display meshes of a result folder: rock (frame M), pedestal (world at the start).

    Raises:
        ResultError: one is missing or damaged.
    """
    path = Path(folder) / MODEL_FOLDER
    return _load(path / ROCK_FILE), _load(path / PEDESTAL_FILE)


def _load(path: Path) -> Triangles:
    arrays = read_arrays(path, {"vertices": np.float64, "faces": np.int32})
    vertices, faces = arrays["vertices"], arrays["faces"]
    good = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3
    if not good or len(faces) == 0 or not np.isfinite(vertices).all():
        raise ResultError(f"{path}: holds no mesh; run the study again")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ResultError(f"{path}: a triangle names a vertex that does not exist")
    return Triangles(vertices, faces)
