"""The verdict: what the posterior says, with its reasons."""

from __future__ import annotations

from dataclasses import dataclass

from vsr2.codes import Statement
from vsr2.diagnosis.verdict.statements import GapState, ReasonCode, VerdictKind
from vsr2.posterior.naming import NAMING
from vsr2.posterior.training import Found, Posterior


@dataclass(frozen=True)
class Verdict:
    """The verdict and why.

    Attributes:
        kind: what is said.
        findings: causes that act together, of each the effects that it may be, the most probable
            first; of an unresolved verdict one, the effects that lead; empty for none and unknown.
        probability: of what is said; of effects, given a gap.
        gap: whether there is one.
        reasons: what led to it.
    """

    kind: VerdictKind
    findings: tuple[tuple[str, ...], ...]
    probability: float
    gap: GapState
    reasons: tuple[Statement, ...]

    @property
    def effects(self) -> tuple[str, ...]:
        """Of all findings."""
        return tuple(name for finding in self.findings for name in finding)

    @property
    def named(self) -> tuple[str, ...]:
        """Effects that it says are missing; none where it says something else."""
        return self.effects if self.kind.names_effects else ()


def verdict_of(found: Found, posterior: Posterior) -> Verdict:
    """The verdict of one campaign.

    Args:
        found: inference on it.
        posterior: trained.
    """
    said, levels = found.naming, posterior.levels
    findings = tuple(tuple(posterior.sets.names[e] for e in one) for one in said.findings)
    names = tuple(name for one in findings for name in one)
    none, probability = float(found.probability[0]), float(said.probability)
    against_none = {"none": none, "limit": levels.none_limit}
    if said.kind is VerdictKind.NONE:
        reasons = [Statement.of(ReasonCode.NO_GAP, **against_none)]
        best = int(found.probability.argmax())
        if best != 0:
            held = posterior.sets.members[best]
            favoured = tuple(n for n, m in zip(posterior.sets.names, held, strict=True) if m)
            reasons.append(Statement.of(ReasonCode.NONE_LESS_PROBABLE, favoured=favoured))
        return Verdict(said.kind, (), none, GapState.NOT_FOUND, tuple(reasons))
    reasons = []
    if none < levels.none_limit:
        reasons.append(Statement.of(ReasonCode.GAP, **against_none))
    if found.fit < NAMING.least_fit:
        misfit = {"fit": found.fit, "limit": NAMING.least_fit, "none": none}
        reasons.append(Statement.of(ReasonCode.MISFIT, **misfit))
    reached = {"probability": probability, "wanted": levels.least_name}
    match said.kind:
        case VerdictKind.UNKNOWN:
            reasons.append(Statement.of(ReasonCode.OUTSIDE_OUTWEIGHS, probability=probability))
        case VerdictKind.PAIR | VerdictKind.SEVERAL:
            reached["wanted"] = levels.least_together
            reasons.append(Statement.of(ReasonCode.TOGETHER_REACHED, **reached))
        case VerdictKind.UNRESOLVED:
            needed = {"effects": names, "classes": said.classes}
            reasons.append(Statement.of(ReasonCode.TOO_MANY_NEEDED, **reached, **needed))
        case _:
            reasons.append(Statement.of(ReasonCode.NAME_REACHED, **reached))
            if said.alike:
                reasons.append(Statement.of(ReasonCode.EQUIVALENT_HERE))
            larger = found.probability[posterior.sets.size > 1]
            two = float(larger.sum() / max(1 - none, 1e-12))
            if two > NAMING.second:
                reasons.append(Statement.of(ReasonCode.SECOND_EFFECT_LIKELY, probability=two))
    return Verdict(said.kind, findings, probability, GapState.FOUND, tuple(reasons))
