"""Runs a diagnosis over a pack, campaign by campaign, from the data alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from vsr2.blind.form.diagnosis_form import (
    DIAGNOSIS_FILE,
    FAILED_FILE,
    Verdict,
    read_verdict,
)
from vsr2.blind.form.pack_form import TIERS
from vsr2.blind.form.seal import (
    KEY_FILE,
    PACK_FILE,
    folder_around,
    make_folder,
    read_json,
    read_pack,
    write_json,
)
from vsr2.campaign import Campaign, Tier, load_campaign
from vsr2.config import load_study
from vsr2.errors import BlindError, Vsr2Error

if TYPE_CHECKING:
    from vsr2.diagnosis import Budget

CAMPAIGNS = 2000
"""Simulated for a protocol."""


class Saved(Protocol):
    """What a diagnosis returns."""

    def save(self, folder: Path, /) -> object:
        """Write `diagnosis.json` and what else there is."""
        ...


Diagnose = Callable[..., Saved]
"""As :func:`vsr2.diagnosis.diagnose`: campaign, scene and keywords."""


@dataclass(frozen=True)
class DiagnosisOptions:
    """How each diagnosis is made, as in :func:`vsr2.diagnosis.diagnose`.

    Attributes:
        campaigns: simulated ones of each protocol; None: by `budget_minutes`.
        budget_minutes: of each diagnosis, without a number of campaigns.
        threads: None: all that this process may use.
        seed: of each diagnosis.

    Raises:
        BlindError: every diagnosis would refuse them.
    """

    campaigns: int | None = CAMPAIGNS
    budget_minutes: float = 10.0
    threads: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        from vsr2.diagnosis.budget import SCHEDULE

        if self.campaigns is not None and self.campaigns < SCHEDULE.fewest:
            raise BlindError(f"campaigns is {self.campaigns}; give at least {SCHEDULE.fewest}")
        if self.campaigns is None and not 0 < self.budget_minutes < math.inf:
            raise BlindError(f"budget_minutes is {self.budget_minutes}; give more than 0")
        if self.threads is not None and self.threads < 1:
            raise BlindError(f"threads is {self.threads}; give at least 1, or leave it out for all")
        if self.seed < 0:
            raise BlindError(f"seed is {self.seed}; give 0 or more")

    @property
    def result(self) -> dict[str, Any]:
        """What decides a diagnosis: seed and budget."""
        if self.campaigns is None:
            return {"budget_minutes": self.budget_minutes, "seed": self.seed}
        return {"campaigns": self.campaigns, "seed": self.seed}

    @property
    def budget(self) -> Budget:
        """Of each diagnosis."""
        from vsr2.diagnosis import Budget

        return Budget(self.budget_minutes, campaigns=self.campaigns)


@dataclass(frozen=True)
class Progress:
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
    noise = replace(campaign.noise, tilt=None, position=None, orientation=None)
    if tier == "B":
        noise = replace(noise, peak_tilt=None)
    trials = tuple(
        replace(t, series=None, peak_tilt=t.peak_tilt if tier == "M" else None)
        for t in campaign.trials
    )
    return replace(campaign, trials=trials, noise=noise)


def uncertainties(tolerances: Mapping[str, Any]) -> dict[str, float]:
    """Standard deviations for the diagnosis from those that a pack publishes.

    What it does not publish keeps the diagnosis' own. Edges that are off by s change the frequency
    parameter p^2 by s, as a moment of inertia does that is off by 4 s: of the moment about an edge,
    4/3 m R^2, a quarter is about the centre.
    """
    tolerances = {name: value for name, value in tolerances.items() if value is not None}
    units = {"friction": 1.0, "yaw": math.degrees(1), "offset": 1.0}
    out = {name: unit * tolerances[name] for name, unit in units.items() if name in tolerances}
    if {"width", "height"} <= set(tolerances):
        out["slenderness"] = math.hypot(tolerances["width"], tolerances["height"])
        out["inertia"] = 4 * tolerances["height"]
    if "input_gain" in tolerances:
        # Root mean square of a log-uniform draw.
        low, high = tolerances["input_gain"]
        spread = 2 * math.log(high / low) if high > low > 0 else 0.0
        out["trial_gain"] = math.sqrt((high**2 - low**2) / spread) if spread else high
    return out


def diagnose_pack(
    data: Path,
    out: Path,
    *,
    tiers: Sequence[Tier] | None = None,
    campaigns: Sequence[str] | None = None,
    options: DiagnosisOptions | None = None,
    diagnose: Diagnose | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Progress:
    """Diagnose the campaigns of a pack; what is there already is kept.

    Results go to `out/<campaign>/<tier>/`, simulations and trained posteriors to `out`: those
    for one campaign serve all of its protocol. Only
    the data folder is read. A campaign whose diagnosis ends with an error of ours gets a
    `failed.json`, and is tried again by the next run.

    Args:
        data: a pack's data folder.
        out: gets the diagnoses.
        tiers: information to use; None: all that the pack has.
        campaigns: ids; None: all.
        options: of each diagnosis; None: their defaults.
        diagnose: stands in for :func:`vsr2.diagnosis.diagnose`.
        say: gets a line for each campaign.

    Raises:
        BlindError: no pack, one of a wrong form, or a campaign or tier that it does not have;
            nothing is written then.
        ConfigError, GeometryError: the scene cannot be used.
    """
    options = DiagnosisOptions() if options is None else options
    pack = read_pack(data)
    listed = {entry["id"]: entry for entry in pack["campaigns"]}
    chosen = _chosen(data, listed, campaigns)
    wanted = _wanted(data, pack["tiers"], tiers)
    known: Collection[str] | None = None
    if diagnose is None:
        from vsr2.diagnosis import diagnose as installed
        from vsr2.effects import library

        diagnose, known = installed, library()
    from vsr2.diagnosis import Execution, Hypotheses, ProtocolCache, with_deviations
    from vsr2.diagnosis.observed.observations import series_sampling

    scene = data / pack["scene"]
    load_study(scene)
    _check_folder(out, data)
    excluded = {name: _excluded(data, listed[name], known, say) for name in chosen}
    _check_tiers(data, chosen, wanted)
    _same_submission(out, pack, options.result)
    nuisances = with_deviations(uncertainties(pack.get("tolerances") or {}))
    cache = ProtocolCache(out, series="T" in pack["tiers"])
    failed = []
    chosen.sort(key=lambda name: int(listed[name].get("protocol") or 0))
    for tier, name in ((tier, name) for tier in wanted for name in chosen):
        folder = out / name / tier
        if (folder / DIAGNOSIS_FILE).exists():
            continue

        def diagnosed(name: str = name, tier: Tier = tier) -> Saved:
            campaign = load_campaign(data / name)
            # Without series too, simulate them as this campaign measured them.
            sampled = replace(cache, sampling=series_sampling(campaign))
            return diagnose(
                at_tier(campaign, tier),
                scene,
                tier=tier,
                budget=options.budget,
                hypotheses=Hypotheses(exclude=excluded[name], nuisances=nuisances),
                execution=Execution(options.threads, cache=sampled),
                seed=options.seed,
            )

        error = (verdict := _save(diagnosed, folder)).failed
        failed += [f"{name} {tier}"] if error else []
        say(f"{name} {tier}: {f'failed: {error}' if error else verdict.kind}")
    return Progress(len(chosen) * len(wanted) - len(failed), tuple(failed))


def _save(diagnosed: Callable[[], Saved], folder: Path) -> Verdict:
    """Write a diagnosis that scoring can read, or why there is none; returns what it reads."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        diagnosed().save(folder)
        verdict = read_verdict(folder)
        (folder / FAILED_FILE).unlink(missing_ok=True)
    except Vsr2Error as error:
        (folder / DIAGNOSIS_FILE).unlink(missing_ok=True)
        write_json(folder / FAILED_FILE, {"error": str(error)})
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


def _excluded(
    data: Path, entry: Mapping[str, Any], known: Collection[str] | None, say: Callable[[str], None]
) -> tuple[str, ...]:
    """What to leave out of the library for a campaign.

    A custodian may withhold effects that the library never had; a name that is nearly one of the
    library's is a slip, which would let the effect in.
    """
    names = tuple(entry.get("exclude") or ())
    for name in names if known is not None else ():
        near = get_close_matches(name, known or (), n=1, cutoff=0.8)
        if name not in (known or ()) and near:
            raise BlindError(
                f"{data / PACK_FILE}: exclude of {entry['id']} names {name!r}, which the library "
                f"lacks; if {near[0]} is meant, publish that name"
            )
        if not near:
            say(f"{entry['id']}: exclude names {name!r}, which the library lacks anyway")
    return tuple(name for name in names if known is None or name in known)


def _check_tiers(data: Path, names: Sequence[str], tiers: Sequence[Tier]) -> None:
    """That some campaign has what each tier uses; one that has not, or is damaged, fails alone."""

    def measured(name: str, key: str) -> bool:
        try:
            return any(getattr(t, key) is not None for t in load_campaign(data / name).trials)
        except Vsr2Error:
            return False

    for tier, key, what in (("M", "peak_tilt", "largest tilts"), ("T", "series", "time series")):
        if tier in tiers and not any(measured(name, key) for name in names):
            raise BlindError(
                f"{data}: no campaign has {what}, which tier {tier} uses; diagnose at other tiers "
                "(--tier)"
            )


def _same_submission(out: Path, pack: dict[str, Any], how: dict[str, Any]) -> None:
    """Note which pack the diagnoses are of, and refuse to mix two."""
    path = out / "submission.json"
    mine = {"schema": "vsr2.blind-submission/1", "pack": pack["commitment"]["sha256"], **how}
    if not path.exists():
        make_folder(out)
        write_json(path, mine)
        return
    there = read_json(path)
    for key in mine:
        if there.get(key) != mine[key]:
            raise BlindError(
                f"{path}: was begun with {key} {there.get(key)!r}, not {mine[key]!r}; continue "
                "with the same, or choose another folder"
            )
