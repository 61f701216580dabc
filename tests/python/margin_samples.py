"""An emulator for tests."""

from __future__ import annotations

import numpy as np

from vsr2.causes.margins.margin_emulator import MarginEmulator, fit_emulator
from vsr2.causes.margins.trial_groups import TrialGroups


def fitted(features, margins, motions=None) -> MarginEmulator:
    """Every scene was asked for all trials."""
    motion = np.arange(margins.shape[1]) if motions is None else np.asarray(motions)
    groups = TrialGroups(motion, np.ones((1, motion.size), dtype=bool))
    return fit_emulator(features, margins, np.zeros(len(features), dtype=int), groups)
