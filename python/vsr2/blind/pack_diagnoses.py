"""Runs a diagnosis over a pack, campaign by campaign, from the data alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vsr2.blind.form.diagnosis_form import (
    DIAGNOSIS_FILE,
    FAILED_FILE,
    Failure,
    FailureCode,
    ReportedVerdict,
    read_verdict,
)
from vsr2.blind.form.events import EventCode, Say, unheard
from vsr2.blind.form.pack_form import Listed, Pack
from vsr2.blind.form.seal import (
    KEY_FILE,
    PACK_FILE,
    folder_around,
    make_folder,
    read_json,
    read_pack,
    write_json,
)
from vsr2.blind.form.uncertainties import uncertainties
from vsr2.campaign import TIERS, Campaign, Tier, load_campaign
from vsr2.codes import Statement
from vsr2.config import load_study
from vsr2.config.problems import shown
from vsr2.config.seeds import checked_seed
from vsr2.diagnosis import Budget, Diagnosis
from vsr2.effects import check_study_effects, library
from vsr2.ensemble import Execution, Hypotheses, Nuisance, ProtocolCache, with_deviations
from vsr2.ensemble.execution import Report, Turn
from vsr2.ensemble.observed.observations import observe_campaign, same_trials, series_sampling
from vsr2.ensemble.simulated.nuisances import with_stated
from vsr2.errors import BlindError, Vsr2Error

SUBMISSION_SCHEMA = "vsr2.blind-submission/1"
SUBMISSION = "submission.json"
BUDGET, EXECUTION = Budget(campaigns=2000), Execution()


@dataclass(frozen=True)
class PackOutcome:
    """What came of a run over a pack.

    Attributes:
        done: diagnoses that are there now.
        failed: campaigns and tiers without one.
    """

    done: int
    failed: tuple[str, ...]


def at_tier(campaign: Campaign, tier: Tier) -> Campaign:
    """The campaign with nothing beyond a tier: what is left out cannot be used by accident."""
    if tier == "T":
        return campaign
    beyond = ["tilt", "position", "orientation", "yaw", "slip"]
    if tier == "B":
        beyond += ["peak_tilt", "peak_tilt_relative"]
    noise = replace(campaign.noise, **dict.fromkeys(beyond))
    trials = tuple(
        replace(
            t,
            series=None,
            peak_tilt=t.peak_tilt if tier == "M" else None,
            final_yaw=None,
            final_slip=None,
        )
        for t in campaign.trials
    )
    return replace(campaign, trials=trials, noise=noise)


def pack_nuisances(pack: Pack) -> tuple[Nuisance, ...]:
    """What is uncertain about a pack's set-up, and not to be diagnosed.

    Its `nuisances` go before its `tolerances`, and these before the diagnosis' own.
    """
    stated = {} if pack.tolerances is None else pack.tolerances.model_dump(exclude_unset=True)
    return with_stated(pack.nuisances, with_deviations(uncertainties(stated)))


def diagnose_pack(
    data: Path,
    out: Path,
    *,
    tiers: Sequence[Tier] | None = None,
    campaigns: Sequence[str] | None = None,
    budget: Budget = BUDGET,
    execution: Execution = EXECUTION,
    seed: int = 0,
    say: Say = unheard,
) -> PackOutcome:
    """Diagnose the campaigns of a pack; what is there already is kept.

    Results go to `out/<campaign>/<tier>/`, simulations and trained posteriors to `out`: those for
    one campaign serve all of its protocol. Only the data folder is read, and everything is checked
    before the first simulation. A campaign that cannot be used, or whose diagnosis ends with an
    error of ours, gets a `failed.json`, and is tried again by the next run. With more campaigns or
    minutes than the folder was begun with, all is diagnosed again from the same cache. References
    of the pack that have no effect serve the other campaigns of equal trials.

    Args:
        data: a pack's data folder.
        out: gets the diagnoses.
        tiers: information to use; None: all that the pack has.
        campaigns: ids; None: all.
        budget: of each diagnosis.
        execution: of each diagnosis; its cache is the pack's.
        seed: of each diagnosis.
        say: gets an event for each campaign.

    Raises:
        BlindError: a seed below 0, no pack, one of a wrong form, a campaign or tier that it does
            not have, or a tier at which none can be diagnosed; nothing is written then.
        ConfigError, GeometryError: the scene cannot be used.
    """
    from vsr2.diagnosis import diagnose

    seed = checked_seed(seed, BlindError)
    pack = read_pack(data)
    listed = {one.id: one for one in pack.campaigns}
    chosen = _chosen(data, listed, campaigns)
    wanted = _wanted(data, pack.tiers, tiers)
    scene = data / pack.scene
    check_study_effects(load_study(scene).effects, scene)
    _check_folder(out, data)
    hypotheses = {name: _hypotheses(pack, listed[name], say) for name in chosen}
    how = _effort(budget) | {"seed": seed}
    older = _older(out, pack, how)
    # Campaigns that share a posterior are neighbours.
    chosen.sort(key=lambda name: (listed[name].protocol, sorted(listed[name].exclude)))
    asked = [(tier, name) for tier in wanted for name in chosen]
    due = [(t, n) for t, n in asked if older or not (out / n / t / DIAGNOSIS_FILE).exists()]
    say(Statement.of(EventCode.CHECKING, due=len(due), of=len(asked)))
    unfit = _unfit(data, asked, due, hypotheses)
    _begin(out, pack, how, older)
    cache = ProtocolCache(out, series="T" in pack.tiers)
    references = _references(data, pack)
    failed = []
    # What cannot be used is said first.
    for number, (tier, name) in enumerate(sorted(due, key=lambda pair: pair not in unfit), 1):
        turn = Turn(number, len(due), name, tier)

        def diagnosed(name: str = name, tier: Tier = tier, turn: Turn = turn) -> Diagnosis:
            campaign = _loaded(data, name)
            # Without series too, simulate them as this campaign measured them.
            sampled = replace(cache, sampling=series_sampling(campaign))
            known = _known(references, name, campaign, tier)
            return diagnose(
                at_tier(campaign, tier), scene, tier=tier, budget=budget, seed=seed,
                hypotheses=replace(hypotheses[name], references=known),
                execution=replace(execution, cache=sampled, report=_at(execution.report, turn)),
            )  # fmt: skip

        verdict = _save(diagnosed, out / name / tier, unfit.get((tier, name)))
        failed += [f"{name} {tier}"] if verdict.failed else []
        say(_event(name, tier, verdict))
    return PackOutcome(len(asked) - len(failed), tuple(failed))


def _at(report: Report | None, turn: Turn) -> Report | None:
    """What adds to progress of which diagnosis it is."""
    return None if report is None else lambda progress: report(replace(progress, turn=turn))


def _event(campaign: str, tier: Tier, verdict: ReportedVerdict) -> Statement:
    """How a diagnosis ended."""
    of = {"campaign": campaign, "tier": tier}
    if verdict.failed:
        cause, message = str(verdict.failed.code), verdict.failed.message
        return Statement.of(EventCode.FAILED, **of, cause=cause, message=message)
    return Statement.of(EventCode.DIAGNOSED, **of, verdict=str(verdict.kind))


def _effort(budget: Budget) -> dict[str, float]:
    """What of a budget decides a diagnosis: its numbers, or else the minutes."""
    given = {name: value for name, value in vars(budget).items() if value is not None}
    minutes, held_out = given.pop("minutes"), given.pop("held_out")
    return (given or {"budget_minutes": minutes}) | {"held_out": held_out}


def _hypotheses(pack: Pack, entry: Listed, say: Say) -> Hypotheses:
    """What a campaign is diagnosed against."""
    excluded = _excluded(entry, say)
    return Hypotheses(exclude=excluded, priors=pack.priors, nuisances=pack_nuisances(pack))


def _loaded(data: Path, campaign: str) -> Campaign:
    """A campaign of the pack, by whose id it goes, whatever name it gives itself."""
    return replace(load_campaign(data / campaign), name=campaign)


def _references(data: Path, pack: Pack) -> dict[str, Campaign]:
    """Campaigns that are known to have no effect, by id; without those that cannot be read."""
    out: dict[str, Campaign] = {}
    for one in pack.campaigns:
        if one.kind is not None and not one.effects:
            with suppress(Vsr2Error):
                out[one.id] = _loaded(data, one.id)
    return out


def _known(
    references: Mapping[str, Campaign], name: str, campaign: Campaign, tier: Tier
) -> list[Campaign]:
    """Other campaigns of the same trials without effect that reach a tier."""
    own = observe_campaign(at_tier(campaign, tier), tier)
    out = []
    for other, one in references.items():
        if other != name:
            with suppress(Vsr2Error):
                seen = observe_campaign(at_tier(one, tier), tier)
                out += [seen.campaign] if same_trials(seen, own) else []
    return out


def _unfit(
    data: Path,
    asked: Sequence[tuple[Tier, str]],
    due: Sequence[tuple[Tier, str]],
    hypotheses: Mapping[str, Hypotheses],
) -> dict[tuple[Tier, str], Vsr2Error]:
    """Why campaigns cannot be diagnosed at a tier; at each tier some can.

    Raises:
        BlindError: of a tier there is none that can.
    """
    unfit: dict[tuple[Tier, str], Vsr2Error] = {}
    for name in dict.fromkeys(name for _, name in due):
        tiers = [tier for tier, one in due if one == name]
        try:
            campaign = _loaded(data, name)
            if not set(hypotheses[name].offered) - set(hypotheses[name].exclude):
                raise BlindError(f"{name}: excludes every effect, so that none is left to look for")
        except Vsr2Error as error:
            unfit |= dict.fromkeys(((tier, name) for tier in tiers), error)
            continue
        for tier in tiers:
            try:
                observe_campaign(at_tier(campaign, tier), tier)
            except Vsr2Error as error:
                unfit[tier, name] = error
    for tier in dict.fromkeys(tier for tier, _ in due):
        mine = [pair for pair in asked if pair[0] == tier]
        if all(pair in unfit for pair in mine):
            raise BlindError(
                f"{data}: no campaign can be diagnosed at tier {tier}: {unfit[mine[0]]}; correct "
                "them, or diagnose at other tiers (--tier)"
            )
    return unfit


def _save(
    diagnosed: Callable[[], Diagnosis], folder: Path, unfit: Vsr2Error | None
) -> ReportedVerdict:
    """Write a diagnosis that scoring can read, or why there is none; returns what it reads.

    Args:
        diagnosed: gives the diagnosis.
        folder: of the campaign and tier.
        unfit: why the campaign cannot be diagnosed; None: it can.
    """
    folder.mkdir(parents=True, exist_ok=True)
    code = FailureCode.CAMPAIGN_UNUSABLE
    try:
        if unfit is not None:
            raise unfit
        code = FailureCode.DIAGNOSIS_ENDED
        found = diagnosed()
        code = FailureCode.DIAGNOSIS_UNREADABLE
        found.save(folder)
        verdict = read_verdict(folder)
        (folder / FAILED_FILE).unlink(missing_ok=True)
    except Vsr2Error as error:
        (folder / DIAGNOSIS_FILE).unlink(missing_ok=True)
        failure = Failure(code=code, error=type(error).__name__, message=str(error))
        write_json(folder / FAILED_FILE, failure.model_dump(mode="json"))
        verdict = read_verdict(folder)
    return verdict


def _chosen(data: Path, listed: Collection[str], campaigns: Sequence[str] | None) -> list[str]:
    """The campaigns to diagnose, all of which are there."""
    chosen = list(listed if campaigns is None else campaigns)
    for name in chosen:
        if name not in listed:
            some = ", ".join(sorted(listed)[:3])
            raise BlindError(f"{data}: has no campaign {name!r}; it has {len(listed)}: {some} ...")
        if not (data / name).is_dir():
            raise BlindError(
                f"{data}: {PACK_FILE} lists {name!r}, but there is no such folder: the pack is not "
                "complete; fetch it again"
            )
    return chosen


def _wanted(data: Path, offered: Collection[str], tiers: Sequence[Tier] | None) -> list[Tier]:
    """The tiers to diagnose at, all of which the pack has."""
    known = [tier for tier in TIERS if tier in offered]
    for tier in tiers or ():
        if tier not in known:
            raise BlindError(f"{data}: has no tier {tier}; it has {', '.join(known)}")
    return known if tiers is None else list(tiers)


def _check_folder(out: Path, data: Path) -> None:
    """Refuse to write among the pack's own files, whose hashes are sealed."""
    if out.resolve().is_relative_to(data.resolve()):
        raise BlindError(f"{out}: lies in the pack's data folder; choose another --out")
    for file, what in ((PACK_FILE, "pack's data"), (KEY_FILE, "key")):
        other = folder_around(out, file)
        if other is not None:
            raise BlindError(f"{out}: lies in a {what} folder, {other}; choose another --out")


def _excluded(entry: Listed, say: Say) -> tuple[str, ...]:
    """What to leave out of the library for a campaign.

    A custodian may withhold effects that the library never had.
    """
    known = library()
    for name in (name for name in entry.exclude if name not in known):
        say(Statement.of(EventCode.EXCLUDED_ANYWAY, campaign=entry.id, effect=name))
    return tuple(name for name in entry.exclude if name in known)


def _submission(pack: Pack, how: Mapping[str, Any]) -> dict[str, Any]:
    return {"schema": SUBMISSION_SCHEMA, "pack": pack.commitment.sha256, **how}


def _older(out: Path, pack: Pack, how: Mapping[str, Any]) -> str:
    """With how much less the folder was begun, as `300-campaigns`; "": with the same, or not yet.

    Raises:
        BlindError: it was begun for another pack or otherwise, or with more, or a value is none
            that a run writes.
    """
    path = out / SUBMISSION
    if not path.exists():
        return ""
    try:
        there = read_json(path)
    except BlindError:
        raise BlindError(
            f"{path}: cannot be read; it says of which pack the diagnoses are: get it back from a "
            "copy, or choose another folder"
        ) from None
    older = ""
    for key, mine in _submission(pack, how).items():
        before = there.get(key)
        # With minutes a folder has no campaigns, and the other way round.
        if key in there and not _is_like(before, mine):
            raise BlindError(
                f"{path}: {key} is {shown(before)}, which no run writes; get it back from a copy, "
                "or choose another folder"
            )
        effort = type(mine) in (int, float) and key != "seed" and before is not None
        if effort and before < mine:
            older = f"{before:g}-{key}"
        elif before != mine:
            option = ", which --no-how-far makes False" if key == "held_out" else ""
            raise BlindError(
                f"{path}: was begun with {key} {shown(before)}, not {mine!r}{option}; continue "
                "with the same (campaigns and minutes may rise), or choose another folder"
            )
    return older


def _is_like(before: object, mine: object) -> bool:
    """Whether a value is of the kind that a run writes."""
    if isinstance(mine, (bool, str)):
        return type(before) is type(mine)
    number = isinstance(before, (int, float)) and not isinstance(before, bool)
    return number and 0 <= before < math.inf  # type: ignore[operator]


def _begin(out: Path, pack: Pack, how: Mapping[str, Any], older: str) -> None:
    """Note which pack the diagnoses are of, and how they are made; set older ones aside."""
    make_folder(out)
    # First of all, or a kill in between would leave older ones that pass for new.
    for path in sorted(out.glob(f"*/*/{DIAGNOSIS_FILE}")) if older else ():
        path.rename(path.with_name(f"{path.stem}-{older}.json"))
    write_json(out / SUBMISSION, _submission(pack, how))
