"""WHERE: locations in which residuals are too large, with control over their whole family.

The score of a location is z = sum r_i w_i / sqrt(sum v_i w_i^2), r the standardised residual of a
trial, v 1 where it is known, w its weights (1 inside, 0 outside; a centred trend; a step). The
nulls are

- for every location: campaigns simulated without effect, nuisances and contact models drawn, and
  disturbed as two correct simulators differ;
- for those over the order of execution besides: permutations of the observed residuals in which
  complete sessions are permuted (in a campaign of one session, and for sessions themselves:
  complete motions). Residuals that hang together within a session look like a trend; permuting
  less than sessions would take that for significant. The larger p value counts. Where sessions, or
  motions, come back again and again, no complete one can be permuted, and nothing is found.

Each score is divided by its null deviation; the family's p value is that of the largest score
(P. H. Westfall and S. S. Young, "Resampling-Based Multiple Testing", 1993). A location stands out
if it is significant and surely holds at least twice its share of the effect: the lower end of the
90 % interval of that share, from a bootstrap over motions, is at least two. The effect is what the
squares of residuals exceed those of campaigns without effect, of outcomes and largest tilts
whatever feature the location was found in; of the table's recordings that of the feature itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.ensemble.observed.features import LARGEST_TILT, Feature, FeatureChannel, Phase
from vsr2.ensemble.observed.random_streams import Stream, generator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ScanConstants:
    """How locations are scanned; chosen by hand.

    Attributes:
        permutations: of sessions or motions: the least p value is 0.001.
        tie: relative difference of two scores up to which they are one, but for rounding.
        most_runs: runs of a session or motion, on average, up to which they are taken for complete.
        significant: family-wise p value up to which a location counts as found.
        concentration: share of the effect over share of the trials that it surely holds if it
            stands out.
        least_trials: fewer are no location.
        least_known: trials whose intensity is known; fewer are not split into thirds.
        least_weight: added to a score's sum of squared weights, for locations of which nothing is
            known.
        least_deviation: null deviation of a score, whose own is 1, that counts at least.
    """

    permutations: int = 999
    tie: float = 1e-9
    most_runs: int = 2
    significant: float = 0.05
    concentration: float = 2.0
    least_trials: int = 3
    least_known: int = 9
    least_weight: float = 1e-3
    least_deviation: float = 0.5


SCAN = ScanConstants()
OUTCOME = Feature("outcome", FeatureChannel.OUTCOME, Phase.RESPONSE)


class LocationAxis(StrEnum):
    """Along what a location differs from the others."""

    CONDITIONS = "conditions"
    ORDER = "order"
    SESSION = "session"
    SPECIMEN = "specimen"


class LocationKind(StrEnum):
    """Which trials a location holds, or what it weighs; with the names of its values."""

    ALL_TRIALS = "all_trials"
    INTENSITY = "intensity"
    """`pga_g`, `pgv_pga_s` or both: the `Third` of the campaign's values."""
    TREND = "trend"
    """Over the order of execution."""
    STEP = "step"
    """`session`: from which on."""
    SESSION = "session"
    """`session`."""
    SPECIMEN = "specimen"
    """`specimen`."""

    @property
    def axis(self) -> LocationAxis:
        """Along which such locations differ from the others."""
        match self:
            case LocationKind.TREND | LocationKind.STEP:
                return LocationAxis.ORDER
            case LocationKind.SESSION:
                return LocationAxis.SESSION
            case LocationKind.SPECIMEN:
                return LocationAxis.SPECIMEN
        return LocationAxis.CONDITIONS


class Third(StrEnum):
    """A third of a campaign's intensities."""

    LOW = "low"
    MIDDLE = "middle"
    HIGH = "high"


@dataclass(frozen=True)
class Location:
    """One location of the family and what was found there.

    Attributes:
        kind: of it.
        values: that go with the kind.
        feature: of the response: which channel and which phase.
        effect_size: mean residual inside over its noise, in standard deviations of one trial.
        p_familywise: of the largest score of the family.
        concentration: share of the effect inside, over the share of trials; 0 where the squares
            exceed nothing.
        concentration_ci90: its 90 % interval.
        trials: inside, of those scanned.
    """

    kind: LocationKind
    values: Mapping[str, str]
    feature: Feature
    effect_size: float
    p_familywise: float
    concentration: float = 1.0
    concentration_ci90: tuple[float, float] = (1.0, 1.0)
    trials: tuple[int, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Which location it is, as it stands in `diagnosis.json`."""
        return {
            "location": {"kind": str(self.kind), "values": dict(self.values)},
            "axis": str(self.kind.axis),
            "feature": self.feature.name,
            "channel": str(self.feature.channel),
            "phase": str(self.feature.phase),
        }

    @property
    def is_significant(self) -> bool:
        """Once all locations are accounted for."""
        return self.p_familywise <= SCAN.significant

    @property
    def stands_out(self) -> bool:
        """Whether it is significant and surely holds more than its share of the effect."""
        return self.is_significant and self.concentration_ci90[0] >= SCAN.concentration


@dataclass(frozen=True, eq=False)
class Conditions:
    """What locations are made of, one value a trial.

    Attributes:
        log_pga_g, log_pgv_pga_s: logarithms of PGA and of PGV / PGA.
        order: of execution.
        session, motion, specimen: indices from 0.
        sessions, specimens: their names by index.
    """

    log_pga_g: Array
    log_pgv_pga_s: Array
    order: Array
    session: NDArray[np.int64]
    motion: NDArray[np.int64]
    specimen: NDArray[np.int64]
    sessions: tuple[str, ...]
    specimens: tuple[str, ...]


def scan(
    observed: Array,
    null: Array,
    conditions: Conditions,
    features: tuple[Feature, ...],
    *,
    seed: int = 0,
) -> list[Location]:
    """Scan all locations.

    Args:
        observed: standardised residuals, 0 where nothing is known, shape (channels, trials).
        null: the same of campaigns simulated without effect, shape (campaigns, channels, trials).
        conditions: of the trials.
        features: of the residuals' channels, `OUTCOME` first.
        seed: of permutations.

    Returns:
        All locations, most significant first.
    """
    family = list(_family(conditions))
    weights = np.stack([one.weight for one in family]).astype(np.float64)
    by_order = np.array([one.kind.axis is LocationAxis.ORDER for one in family])
    by_session = np.array([one.kind is LocationKind.SESSION for one in family])
    rng = generator(seed, Stream.LOCATIONS)
    known = (observed != 0).astype(np.float64)
    score = _scores(observed[None], known[None], weights)[0]
    p_value = _family_p(score, _scores(null, (null != 0).astype(np.float64), weights))
    # One session has no order of sessions: then that of its motions is permuted.
    ordered = conditions.session if conditions.session.max() > 0 else conditions.motion
    for inside, runs in ((by_session, conditions.motion), (by_order, ordered)):
        if interleaved(runs):
            p_value[:, inside] = 1.0
        elif inside.any():
            moves = np.stack([_permutation(runs, rng) for _ in range(SCAN.permutations)])
            moved = _scores(
                observed[:, moves].swapaxes(0, 1), known[:, moves].swapaxes(0, 1), weights[inside]
            )
            p_value[:, inside] = np.maximum(p_value[:, inside], _family_p(score[:, inside], moved))
    # What the squares exceed those of gap-free campaigns is the effect's.
    excess = observed**2 - (null**2).mean(axis=0)
    response = sum(e for e, f in zip(excess, features, strict=True) if f in (OUTCOME, LARGEST_TILT))
    # Of a trend, the later half; of a step, what follows it.
    inside = weights > 0
    counts = _resampled_counts(conditions.motion, rng)
    of_response = _concentrations(np.asarray(response), inside, counts)
    out = []
    for c, feature in enumerate(features):
        of_table = feature.channel is FeatureChannel.TABLE
        shares = _concentrations(excess[c], inside, counts) if of_table else of_response
        for j, one in enumerate(family):
            count = max(int(np.count_nonzero(known[c] * (weights[j] != 0))), 1)
            value, low, high = (float(part[j]) for part in shares)
            out.append(
                Location(
                    one.kind, one.values, feature, float(score[c, j] / np.sqrt(count)),
                    float(p_value[c, j]), value, (low, high),
                    tuple(np.flatnonzero(inside[j]).tolist()),
                )
            )  # fmt: skip
    return sorted(out, key=lambda one: (one.p_familywise, -abs(one.effect_size)))


def _resampled_counts(motion: NDArray[np.int64], rng: np.random.Generator) -> Array:
    """How often each trial is drawn where motions are, shape (1 + resamples, trials); once first.

    Trials of a motion hang together.
    """
    motions, index = np.unique(motion, return_inverse=True)
    count = motions.size
    drawn = rng.multinomial(count, np.full(count, 1 / count), INTERVALS.replicates)
    return np.concatenate([np.ones((1, index.size)), drawn[:, index]])


def _concentrations(excess: Array, inside: NDArray[np.bool_], counts: Array) -> Array:
    """Share of the effect over share of the trials, and its interval, shape (3, locations).

    The interval is of resamples that hold a trial of the location.

    Args:
        excess: of each trial, shape (trials,).
        inside: shape (locations, trials).
        counts: see :func:`_resampled_counts`.
    """
    own, size = counts @ (inside * excess).T, counts @ inside.T
    mean = (counts @ excess / counts.sum(axis=1))[:, None]
    share = np.divide(own, size * mean, out=np.zeros(own.shape), where=(size > 0) & (mean > 0))
    share[size == 0] = np.nan
    return np.concatenate([share[:1], np.nanquantile(share[1:], INTERVALS.inner, axis=0)])


def _scores(residual: Array, variance: Array, weights: Array) -> Array:
    """Shape (campaigns, channels, locations)."""
    top = residual @ weights.T
    squares = variance @ (weights**2).T + SCAN.least_weight
    return np.asarray(top / np.sqrt(squares), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Weighed:
    """A location before its score: kind and values, and a weight a trial."""

    kind: LocationKind
    weight: Array | NDArray[np.bool_]
    values: Mapping[str, str] = field(default_factory=dict)


def _family(conditions: Conditions) -> Iterator[_Weighed]:
    """All trials, and what holds `SCAN.least_trials` or more."""
    yield _Weighed(LocationKind.ALL_TRIALS, np.ones(conditions.order.size))
    for one in _parts(conditions):
        if np.count_nonzero(one.weight) >= SCAN.least_trials:
            yield one


def _parts(conditions: Conditions) -> Iterator[_Weighed]:
    thirds: dict[str, Mapping[str, NDArray[np.bool_]]] = {}
    for name, value in (("pga_g", conditions.log_pga_g), ("pgv_pga_s", conditions.log_pgv_pga_s)):
        known = np.isfinite(value)
        if known.sum() < SCAN.least_known:
            continue
        part = np.digitize(value, np.quantile(value[known], [1 / 3, 2 / 3]))
        thirds[name] = {third: known & (part == k) for k, third in enumerate(Third)}
        for third, inside in thirds[name].items():
            yield _Weighed(LocationKind.INTENSITY, inside, {name: third})
    if len(thirds) == 2:
        for pga, ratio in product(*(held.items() for held in thirds.values())):
            values = {"pga_g": pga[0], "pgv_pga_s": ratio[0]}
            yield _Weighed(LocationKind.INTENSITY, pga[1] & ratio[1], values)
    yield _Weighed(LocationKind.TREND, conditions.order - conditions.order.mean())
    for s, session in enumerate(conditions.sessions[1:], 1):
        after = conditions.session >= s
        yield _Weighed(LocationKind.STEP, after - after.mean(), {"session": session})
    for kind, index, names in (
        (LocationKind.SESSION, conditions.session, conditions.sessions),
        (LocationKind.SPECIMEN, conditions.specimen, conditions.specimens),
    ):
        for k, name in enumerate(names if len(names) > 1 else ()):
            yield _Weighed(kind, index == k, {str(kind): name})


def _family_p(score: Array, null: Array) -> Array:
    """P value of each score among the largest of the family, shape (channels, locations).

    What lies within rounding of the score counts as reaching it: a permutation that leaves all as
    it was.
    """
    deviation = np.maximum(np.sqrt((null**2).mean(axis=0)), SCAN.least_deviation)
    largest = np.sort(np.abs(null / deviation).reshape(len(null), -1).max(axis=1))
    below = np.searchsorted(largest, (1 - SCAN.tie) * np.abs(score / deviation))
    return np.asarray((1 + len(null) - below) / (len(null) + 1), dtype=np.float64)


def interleaved(label: NDArray[np.int64]) -> bool:
    """Whether labels come back so often that runs of one are only parts of what hangs together."""
    return bool(1 + np.count_nonzero(np.diff(label)) > SCAN.most_runs * np.unique(label).size)


def _permutation(label: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    """Trials after complete runs of one label were permuted, shape (trials,)."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(label) != 0]))
    ends = np.append(starts[1:], label.size)
    return np.concatenate([np.arange(starts[k], ends[k]) for k in rng.permutation(starts.size)])
