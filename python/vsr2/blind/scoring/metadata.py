"""What the files of a campaign say without what happened in it."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsr2.campaign import Campaign
from vsr2.campaign.trials_table import TRIALS

CAMPAIGN_FILE = "campaign.yaml"
_RESPONSE = ("overturned", "peak_tilt_rad")


@dataclass(frozen=True)
class MetadataRules:
    """What of series is metadata; chosen by hand.

    Attributes:
        falling: tilt beyond which a series may end with the fall [rad].
    """

    falling: float = 1.0


METADATA = MetadataRules()


def metadata(campaign: Campaign, folder: Path) -> dict[str, float]:
    """Sizes, counts, digits, noise, amplitudes and ends, by code.

    Numbers that the response moves are left out: the length of its cells in the table, and series
    of rocks that fell, which end with the fall. How long after the motion the others end is
    given in complete sampling intervals.

    Args:
        campaign: loaded.
        folder: of it.
    """
    noise = campaign.noise
    pga = np.log([trial.pga_g or 1.0 for trial in campaign.trials])
    motions = sorted((folder / "motions").glob("*.npz"))
    cells = _cells(folder / TRIALS)
    response = [cells.get(name, []) for name in _RESPONSE]
    rest = [values for column, values in cells.items() if column not in _RESPONSE]
    size = (folder / TRIALS).stat().st_size - sum(len(v) for values in response for v in values)
    return {
        "trials": float(len(campaign)),
        "motions": float(len(set(campaign.motion_ids))),
        "sessions": float(len({trial.session for trial in campaign.trials})),
        "files": float(sum(1 for _ in folder.rglob("*"))),
        "displacement_noise": math.log(noise.displacement or 1.0),
        "acceleration_noise": math.log(noise.acceleration or 1.0),
        "mean_ln_pga_g": float(pga.mean()),
        "spread_of_ln_pga": float(pga.std()),
        "mean_size_of_motions": _mean([float(file.stat().st_size) for file in motions]),
        "size_of_campaign_file": float((folder / CAMPAIGN_FILE).stat().st_size),
        "size_of_the_trials_header": float(sum(len(name) for name in cells)),
        "size_of_the_trials_but_the_response": float(size),
        "most_decimals_of_the_response": _most_decimals(response),
        "most_decimals_of_the_rest": _most_decimals(rest),
        "end_of_series_after_the_motion": _end(campaign),
    }


def _cells(path: Path) -> dict[str, list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return {name: [row[i] for row in rows[1:] if i < len(row)] for i, name in enumerate(rows[0])}


def _most_decimals(columns: Iterable[Sequence[str]]) -> float:
    return float(max((len(c.partition(".")[2]) for cells in columns for c in cells), default=0))


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else 0.0


def _end(campaign: Campaign) -> float:
    """Mean time from the motion's end to the series' end [s], up to a complete interval."""
    ends = []
    for trial in campaign.trials:
        record, series = campaign.record(trial), trial.series
        if series is None or series.tilt is None or record is None:
            continue
        if np.nanmax(series.tilt) < METADATA.falling:
            interval = float(np.median(np.diff(series.time))) if len(series.time) > 1 else 1.0
            beyond = float(series.time[-1]) - record.duration
            ends.append(interval * math.ceil(beyond / interval - 1e-6))
    return round(_mean(ends), 6)
