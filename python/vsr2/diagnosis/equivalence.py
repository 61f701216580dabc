"""Which effects a campaign cannot tell apart.

For the leading effect at its posterior mode, the best a rival can do in expectation is

    D = min over rival's parameters and nuisances z of  E[log p_leader - log p_rival]
        + (|z_rival|^2 - |z_leader|^2) / 2,

summed over trials, the expectation over outcomes (and features) that the leader predicts. Twice D
is about the variance of the log likelihood ratio under the leader, so that the better of the two is
picked wrongly with probability Phi(-sqrt(D / 2)) (H. Chernoff's problem for nearby hypotheses).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vsr2.diagnosis.evidence import Data, Posterior, Table, mode, posterior
from vsr2.diagnosis.library import NONE

INSEPARABLE = 3.28
"""D [nat] at which the better of two effects is picked wrongly one time in ten."""
EXCLUDED = 0.05
"""A rival less probable than this share of its leader is ruled out by the campaign at hand, unless the
two are the same to it (`SAME`)."""
SAME = 1.0
"""D [nat] below which nothing that a campaign shows can part two effects but their priors."""


def expected_campaign(table: Table, found: Posterior) -> tuple[Data, float]:
    """What a hypothesis at its posterior mode expects, and |z|^2 / 2 there."""
    node, z = mode(table, found)
    at = table.fine
    logit = at.logit[node] + at.factor[node] * (table.slope @ z)
    p = 1 / (1 + np.exp(-np.clip(logit, -30, 30)))
    features = [
        centre[node] + response @ z
        for centre, response in zip(at.centre, table.response, strict=True)
    ]
    shape = (1, p.size, 0)
    stacked = np.stack(features, axis=-1)[None] if features else np.zeros(shape)
    return Data(p[None], stacked), 0.5 * float(z @ z)


def masked(expected: Data, observed: Data) -> Data:
    """Left out wherever the observed campaign has nothing."""
    return Data(
        np.where(np.isfinite(observed.overturned), expected.overturned, np.nan),
        np.where(np.isfinite(observed.features), expected.features, np.nan),
    )


def separations(
    leader: str,
    tables: Mapping[str, Table],
    posteriors: Mapping[str, Posterior],
    observed: Data,
) -> dict[str, float]:
    """D of every rival of `leader` [nat], 0 or more."""
    expected, _ = expected_campaign(tables[leader], posteriors[leader])
    data = masked(expected, observed)
    own = float(posterior(tables[leader], data).best[0])
    return {
        name: max(own - float(posterior(table, data).best[0]), 0.0)
        for name, table in tables.items()
        if name != leader
    }


def classes(
    probability: Mapping[str, float],
    tables: Mapping[str, Table],
    posteriors: Mapping[str, Posterior],
    observed: Data,
    exponent: float = 1.0,
) -> list[list[str]]:
    """Partition of the effects: each leader takes those inseparable from it and not ruled out.

    Args:
        probability: of each hypothesis.
        tables: of each hypothesis.
        posteriors: of each hypothesis.
        observed: the campaign.
        exponent: that the log likelihood needs to be calibrated; D is multiplied by it.

    Returns:
        Classes, most probable leader first.
    """
    left = sorted((n for n in tables if n != NONE), key=lambda n: -probability[n])
    out: list[list[str]] = []
    while left:
        leader = left[0]
        found = separations(leader, tables, posteriors, observed)
        members = [leader] + [
            n
            for n in left[1:]
            if exponent * found[n] < SAME
            or (
                exponent * found[n] < INSEPARABLE
                and probability[n] >= EXCLUDED * probability[leader]
            )
        ]
        out.append(members)
        left = [n for n in left if n not in members]
    return out
