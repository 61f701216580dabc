"""A study whose trials are run apart, and the comparison of what comes back."""

from __future__ import annotations

import numpy as np

from vsr2.results import BatchResult

# Not the fastest engine, so that there is time to interfere.
STUDY = """
name: far
engine: {mode: exact}
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion:
  mode: grid_cosine
  pga_g: {min: 0.1, max: 0.6, step: 0.05}
  pgv_pga_s: {min: 0.1, max: 0.2, step: 0.05}
output: {log_every: 10, contacts_every: 100, figures: false}
"""


def assert_same(a: BatchResult, b: BatchResult, *, but: int | None = None) -> None:
    assert len(a) == len(b)
    kept = [i for i in range(len(a)) if i != but]
    for name in a.trials:
        np.testing.assert_array_equal(a[name][kept], b[name][kept], err_msg=name)
    for i in kept:
        left, right = a.logs[i], b.logs[i]
        assert left is not None
        assert right is not None
        for name in ("state", "contacts", "settled_position", "settled_orientation", "foot"):
            assert getattr(left, name).tobytes() == getattr(right, name).tobytes()
        assert left.mass_center.tobytes() == right.mass_center.tobytes()
        assert left.principal_axes.tobytes() == right.principal_axes.tobytes()
