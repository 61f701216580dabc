"""Which effects a campaign cannot tell apart.

For the leading effect at its posterior mode, the best a rival can do in expectation is

    D = min over rival's parameters and nuisances z of  E[log p_leader - log p_rival]
        + (|z_rival|^2 - |z_leader|^2) / 2,

summed over trials, the expectation over outcomes (and features) that the leader predicts. Twice D
is about the variance of the log likelihood ratio under the leader, so that the better of the two is
picked wrongly with probability Phi(-sqrt(D / 2)) (H. Chernoff's problem for nearby hypotheses).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from vsr2.diagnosis.likelihood.evidence import Data, Posterior, Table, mode, posterior
from vsr2.diagnosis.simulated.library import NONE
from vsr2.effects import library

LEAST_PROBABILITY = 0.8
"""Of a class that is named, given that something is missing."""
LEAST_SHARE = 0.005
"""Of that probability, below which a member is not named."""
LEAST_SHARE_ALIKE = 0.0005
"""The same of members that theory takes for about the same as the leader."""
CONFOUNDED = 5.0
"""How much more separation effects need that theory takes for about the same: what is left between
them is of second order, where the emulator is weakest."""
INSEPARABLE = 3.28
"""D [nat] at which the better of two effects is picked wrongly one time in ten."""
MOST_ODDS = 9.0
"""Of the leader of a class against a member that theory takes for about the same: no more can be
true of two of which the better is picked wrongly one time in ten or more."""


def expected_campaign(table: Table, found: Posterior) -> tuple[Data, float]:
    """What a hypothesis at its posterior mode expects, and |z|^2 / 2 there."""
    node, z = mode(table, found)
    at = table.fine
    logit = at.logit[node] + at.factor[node] * table.slope(z)
    p = 1 / (1 + np.exp(-np.clip(logit, -30, 30)))
    features = [
        centre[node] + response(z)
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
    confounded: Mapping[str, Collection[str]] | None = None,
) -> list[list[str]]:
    """Partition of the effects: each leader takes all that are inseparable from it.

    Args:
        probability: of each hypothesis.
        tables: of each hypothesis.
        posteriors: of each hypothesis.
        observed: the campaign.
        exponent: that the log likelihood needs to be calibrated; D is multiplied by it.
        confounded: effects that theory takes for about the same as each effect; None: as the
            library of effects declares.

    Returns:
        Classes, most probable leader first.
    """
    alike = takes_for_alike(confounded)
    left = sorted((n for n in tables if n != NONE), key=lambda n: -probability[n])
    out: list[list[str]] = []
    while left:
        leader = left[0]
        found = separations(leader, tables, posteriors, observed)
        members = [leader]
        for name in left[1:]:
            limit = INSEPARABLE * (CONFOUNDED if alike(leader, name) else 1.0)
            if exponent * found[name] < limit:
                members.append(name)
        out.append(members)
        left = [n for n in left if n not in members]
    return out


def taken_for_same(
    probability: Mapping[str, float],
    group: Sequence[str],
    confounded: Mapping[str, Collection[str]] | None = None,
) -> list[str]:
    """A class' leader, and those members that theory takes for the same and evidence leaves in.

    Args:
        probability: of each hypothesis.
        group: the class, its leader first.
        confounded: as in :func:`classes`.
    """
    alike = takes_for_alike(confounded)
    least = LEAST_SHARE_ALIKE * sum(probability[name] for name in group)
    return [
        name
        for name in group
        if name == group[0] or (alike(group[0], name) and probability[name] >= least)
    ]


def evened(
    probability: Mapping[str, float],
    groups: Sequence[Sequence[str]],
    confounded: Mapping[str, Collection[str]] | None = None,
) -> dict[str, float]:
    """Probabilities in which no leader of a class has odds beyond `MOST_ODDS` against the others.

    What all members of a class have together stays.

    Args:
        probability: of each hypothesis.
        groups: classes.
        confounded: as in :func:`classes`.
    """
    out = dict(probability)
    for group in groups:
        same = taken_for_same(probability, group, confounded)
        raised = {n: max(probability[n], probability[group[0]] / MOST_ODDS) for n in same}
        share = sum(probability[n] for n in same) / max(sum(raised.values()), 1e-300)
        out |= {name: share * value for name, value in raised.items()}
    return out


def takes_for_alike(
    declared: Mapping[str, Collection[str]] | None = None,
) -> Callable[[str, str], bool]:
    """Whether theory takes two effects for about the same.

    Args:
        declared: of each effect; None: as the library of effects declares.
    """
    known = (
        {name: effect.confounded_with for name, effect in library().items()}
        if declared is None
        else declared
    )
    return lambda one, other: other in known.get(one, ()) or one in known.get(other, ())


def leading_class(
    probability: Mapping[str, float],
    groups: Sequence[Sequence[str]],
    confounded: Mapping[str, Collection[str]] | None = None,
) -> tuple[tuple[str, ...], float]:
    """The fewest leading classes that hold most of the probability of something missing.

    Args:
        probability: of each hypothesis.
        groups: classes, the leading one first.
        confounded: as in :func:`classes`.

    Returns:
        Their members, most probable first, and their probability given that something is missing.
    """
    something = max(1 - float(probability[NONE]), 1e-9)
    members = list(groups[0])
    within = sum(float(probability[name]) for name in members) / something
    for group in sorted(groups[1:], key=lambda g: -sum(probability[name] for name in g)):
        if within >= LEAST_PROBABILITY:
            break
        members += group
        within += sum(float(probability[name]) for name in group) / something
    alike, leader = takes_for_alike(confounded), groups[0][0]

    def least(name: str) -> float:
        kept = name in groups[0] and alike(leader, name)
        return (LEAST_SHARE_ALIKE if kept else LEAST_SHARE) * within * something

    members = [n for n in members if probability[n] >= least(n)]
    return tuple(sorted(members, key=lambda n: -probability[n])), min(within, 1.0)
