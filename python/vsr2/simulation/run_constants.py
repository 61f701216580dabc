"""Tuned numbers that results of trials rest on, gathered for their provenance."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vsr2 import _native
from vsr2.effects.actuation import ACTUATION
from vsr2.effects.mechanism import CATCH
from vsr2.effects.order import ORDER
from vsr2.effects.oscillator import OSCILLATOR
from vsr2.effects.rounding import ROUNDING
from vsr2.effects.standing import STANDING
from vsr2.effects.support import SUPPORT
from vsr2.motion.channel_agreement import AGREEMENT
from vsr2.motion.fusion import FUSION
from vsr2.motion.processing import PROCESSING
from vsr2.motion.resample import RESAMPLE
from vsr2.motion.study_motions import RECORDED
from vsr2.motion.synthetic import SYNTHETIC
from vsr2.motion.text_table import TIME_COLUMN
from vsr2.scene.build import NOTES
from vsr2.scene.mesh_repair import REPAIR
from vsr2.scene.placement import PLACEMENT
from vsr2.scene.stability import STABILITY
from vsr2.scene.urdf import URDF


def run_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers of scenes, motions and effects, by what they are of; `core`: the native core's.

    `cpp/include/vsr2/constants.hpp` says what each of the core is, its unit and its source.
    """
    return {
        "mesh_repair": asdict(REPAIR),
        "urdf": asdict(URDF),
        "placement": asdict(PLACEMENT),
        "stability": asdict(STABILITY),
        "notes": asdict(NOTES),
        "channel_agreement": asdict(AGREEMENT),
        "recorded": asdict(RECORDED),
        "processing": asdict(PROCESSING),
        "fusion": asdict(FUSION),
        "synthetic": asdict(SYNTHETIC),
        "resample": asdict(RESAMPLE),
        "time_column": asdict(TIME_COLUMN),
        "actuation": asdict(ACTUATION),
        "catch": asdict(CATCH),
        "order": asdict(ORDER),
        "oscillator": asdict(OSCILLATOR),
        "rounding": asdict(ROUNDING),
        "standing": asdict(STANDING),
        "support": asdict(SUPPORT),
        "core": _native.core_constants(),
    }
