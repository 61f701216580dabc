"""From residuals to locations: what is scanned of an observed campaign."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.where.scan import OUTCOME, Conditions, Location, scan
from vsr2.ensemble.observed.features import Feature
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.observed.table_motion import TABLE_FEATURES, table_residuals

Array = NDArray[np.float64]


def where_it_lies(
    seen: Observations,
    trials: NDArray[np.int64],
    residuals: Array,
    gap_free: NDArray[np.floating[Any]],
    seed: int,
) -> list[Location]:
    """Scan outcomes, features and, where it was recorded twice, the table.

    Args:
        seen: the observed campaign.
        trials: indices of those that were simulated.
        residuals: standardised, shape (columns,): channel by channel, one column a trial.
        gap_free: those of campaigns without effect, shape (campaigns, columns).
        seed: of permutations.
    """
    conditions = Conditions(
        seen.log_pga_g[trials],
        seen.log_pgv_pga_s[trials],
        seen.order[trials],
        seen.session[trials],
        seen.motion[trials],
        seen.specimen[trials],
        _names(seen.session, [trial.session for trial in seen.campaign.trials]),
        _names(seen.specimen, [trial.specimen for trial in seen.campaign.trials]),
    )
    own = residuals.reshape(-1, trials.size)
    null = gap_free.astype(np.float64).reshape(len(gap_free), -1, trials.size)
    features: tuple[Feature, ...] = (OUTCOME, *seen.measured)
    used = seen.campaign.select(np.isin(np.arange(len(seen)), trials))
    table = table_residuals(used, null=len(null), seed=seed)
    if table is not None:
        own = np.concatenate([own, table.residual])
        null = np.concatenate([null, table.null], axis=1)
        features += TABLE_FEATURES
    return scan(own, null, conditions, features, seed=seed)


def _names(index: NDArray[np.int64], names: list[str]) -> tuple[str, ...]:
    """By index."""
    return tuple(names[int(np.argmax(index == i))] for i in range(int(index.max()) + 1))
