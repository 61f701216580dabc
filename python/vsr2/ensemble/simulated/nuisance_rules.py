"""What nuisances of one list must be to one another, whichever way they were stated."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from vsr2.ensemble.simulated.nuisances import Nuisance, Scope
from vsr2.errors import DiagnosisError


def assert_together(nuisances: Sequence[Nuisance]) -> None:
    """Refuse nuisances that would undo each other, or do nothing.

    Raises:
        DiagnosisError: two of one effect, parameter and scope; of several scopes, of which a later
            value takes the place of an earlier one; of an effect that cannot act twice; one that
            does nothing on its own; or one alone in its group.
    """
    _assert_distinct(nuisances)
    _assert_grouped(nuisances)
    _assert_moved(nuisances)
    kinds: dict[str, list[Nuisance]] = defaultdict(list)
    for one in nuisances:
        if not _is_still(one):
            kinds[one.acting.name].append(one)
    for same in kinds.values():
        same.sort(key=lambda one: _WIDEST_FIRST.index(one.drawn_for))
        _assert_kept(same)
        _assert_once(same)


_WIDEST_FIRST = (Scope.CAMPAIGN, Scope.MOTION, Scope.TRIAL)


def _assert_grouped(nuisances: Sequence[Nuisance]) -> None:
    groups = [(one.group, one.scope) for one in nuisances]
    for one, group in zip(nuisances, groups, strict=True):
        if one.group and groups.count(group) == 1:
            raise DiagnosisError(
                f"nuisance {one.name!r}: is alone in its group {one.group!r} with scope "
                f"{one.scope}; give another nuisance of that scope the same group, or leave group "
                "and correlation out"
            )


def _assert_distinct(nuisances: Sequence[Nuisance]) -> None:
    known: dict[tuple[str, str, Scope], Nuisance] = {}
    for one in nuisances:
        what = one.acting.name, one.parameter
        for scope in dict.fromkeys((one.scope, one.drawn_for)):
            other = known.get((*what, scope))
            if other is not None:
                # What an effect draws itself acts with what is drawn for a campaign.
                scopes = " and ".join(dict.fromkeys((other.scope, one.scope)))
                raise DiagnosisError(
                    f"nuisances {other.name!r} and {one.name!r}: both are of {'.'.join(what)} with "
                    f"scope {scopes}; leave one of them out, or give it another scope"
                )
            known[*what, scope] = one


def _assert_moved(nuisances: Sequence[Nuisance]) -> None:
    moved = {(n.acting.name, n.drawn_for) for n in nuisances if not n.secondary}
    for one in nuisances:
        name, scope = one.acting.name, one.drawn_for
        if one.secondary and (name, scope) not in moved:
            raise DiagnosisError(
                f"nuisance {one.name!r}: {one.parameter} does nothing on its own; add a "
                f"nuisance of another parameter of {name} with its scope, {scope}, or leave it "
                "out"
            )


def _is_still(one: Nuisance) -> bool:
    """Whether its only value leaves everything as it is."""
    if one.prior.sd != 0:
        return False
    value = one.prior.value(0.0)
    return value == 1 if one.relative else one.acting.parameter(one.parameter).is_null(value)


def _assert_kept(same: Sequence[Nuisance]) -> None:
    """No value of a wider scope is replaced by one of a narrower scope.

    Args:
        same: of one effect, the widest scope first.
    """
    wider: dict[str, Nuisance] = {}
    for one in same:
        other = wider.setdefault(one.parameter, one)
        replaces = one.acting.parameter(one.parameter).twice == "later" and not one.relative
        if replaces and other is not one:
            raise DiagnosisError(
                f"nuisance {one.name!r}: its {one.parameter} of scope {one.drawn_for} would take "
                f"the place of that of scope {other.drawn_for}; make it `relative`, or leave one "
                "of them out"
            )


def _assert_once(same: Sequence[Nuisance]) -> None:
    """What cannot act twice comes from one scope, and of motions and trials by one nuisance.

    Args:
        same: of one effect, the widest scope first.
    """
    acting: dict[tuple[Scope, str], Nuisance] = {}
    held: set[str] = set()
    for one in same:
        effect = one.acting
        joins = effect.parameter(one.parameter).secondary
        if effect.once and not joins and not (one.relative and one.parameter in held):
            own = "" if one.drawn_for is Scope.CAMPAIGN else one.parameter
            acting[one.drawn_for, own] = one
        held.add(one.parameter)
    if len(acting) > 1:
        first, second, *_ = acting.values()
        raise DiagnosisError(
            f"nuisance {second.name!r}: its {second.parameter} of scope {second.drawn_for} would "
            f"act beside the {first.parameter} of scope {first.drawn_for}, and "
            f"{second.acting.name} cannot act twice: {second.acting.once}; leave one of them out"
        )
