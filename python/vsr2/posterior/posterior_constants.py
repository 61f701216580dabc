"""Tuned numbers of the learned posterior, gathered for provenance."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vsr2.posterior.calibration import CALIBRATED
from vsr2.posterior.discrepancy import DISCREPANCY
from vsr2.posterior.discrepancy_size import DISCREPANCY_SIZE
from vsr2.posterior.effect_curves import EFFECT_CURVE
from vsr2.posterior.naming import NAMING
from vsr2.posterior.network import NETWORK
from vsr2.posterior.outside import OUTSIDE
from vsr2.posterior.parameters import PARAMETERS
from vsr2.posterior.second_cause import SECOND_CAUSE
from vsr2.posterior.summaries import SUMMARY
from vsr2.posterior.truth import PRIOR
from vsr2.posterior.withheld_parts import WITHHELD
from vsr2.posterior.within_library import TRAINING


def posterior_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers of training, calibration and naming, by what they are of."""
    return {
        "discrepancy": asdict(DISCREPANCY),
        "discrepancy_size": asdict(DISCREPANCY_SIZE),
        "summaries": asdict(SUMMARY),
        "network": asdict(NETWORK),
        "prior": asdict(PRIOR),
        "training": asdict(TRAINING),
        "effect_curves": asdict(EFFECT_CURVE),
        "second_cause": asdict(SECOND_CAUSE),
        "calibration": asdict(CALIBRATED),
        "parameters": asdict(PARAMETERS),
        "outside": asdict(OUTSIDE),
        "withheld": asdict(WITHHELD),
        "naming": asdict(NAMING),
    }
