"""`vsr2.diagnose`: a campaign against the scene of a study."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from vsr2.campaign import Campaign, Tier, load_campaign
from vsr2.config import Study, load_study
from vsr2.diagnosis.budget import SCHEDULE, Budget
from vsr2.diagnosis.observed.observations import observe_campaign
from vsr2.diagnosis.pipeline import diagnose_with
from vsr2.diagnosis.protocol_cache import ProtocolCache
from vsr2.diagnosis.simulated.nuisances import Nuisance
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.diagnosis.verdict.document import Diagnosis
from vsr2.errors import DiagnosisError

if TYPE_CHECKING:
    import distributed

    from vsr2.effects import Effect

CACHE_FILE = "simulations.jsonl"


def diagnose(
    campaign: Campaign | str | PathLike[str],
    scene: Study | str | PathLike[str],
    *,
    tier: Tier | None = None,
    out: str | PathLike[str] | None = None,
    budget_minutes: float = 10.0,
    simulations: int | None = None,
    draws: int | None = None,
    cache: ProtocolCache | None = None,
    threads: int | None = None,
    client: distributed.Client | None = None,
    library: Mapping[str, Effect] | None = None,
    exclude: Collection[str] = (),
    priors: Mapping[str, tuple[float, float]] | None = None,
    nuisances: Sequence[Nuisance] | None = None,
    seed: int = 0,
    progress: bool = False,
) -> Diagnosis:
    """Where the sim-to-real gap of a campaign lies, which effect causes it, how far it shrinks.

    Args:
        campaign: measured (or simulated) trials, or the folder that holds them.
        scene: the study of the nominal scene, or its file; its own motions are not used.
        tier: information to use: B outcomes, M largest tilts too, T series too; None: all that the
            campaign shares.
        out: folder for `diagnosis.json` (without sentences), tables and the simulation cache, which
            later runs reuse; None: nothing is written.
        budget_minutes: of wall time, 0.85 of it for simulations; turned into their number by what
            the first simulation of every trial cost.
        simulations: greatest number of simulations instead; equal numbers give equal verdicts.
        draws: of every effect instead, in one round whatever it costs; at least 6.
        cache: what diagnoses of several campaigns of the same trials have in common: simulate and
            fit once.
        threads: of the native core; None: all that this process may use.
        client: of a Dask cluster that runs the trials.
        library: effects that may be the cause; None: all that are registered.
        exclude: names of effects left out.
        priors: lower and upper end of other priors, by `effect.parameter`, in its unit.
        nuisances: what is uncertain about the set-up; None: `DEFAULT_NUISANCES`.
        seed: of everything random.
        progress: write stage, share done and leading classes to standard error.

    Returns:
        The diagnosis.

    Raises:
        DiagnosisError: the campaign holds too little, or an option cannot be used.
        CampaignError, ConfigError, GeometryError, MotionError, SimulationError: campaign or scene
            cannot be used.
    """
    _check_options(budget_minutes, simulations, draws, seed, threads)
    offered = _with_priors(library, priors or {})
    given = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
    study = scene if isinstance(scene, Study) else load_study(scene)
    seen = observe_campaign(given, tier)
    simulator = SceneSimulator(
        seen.campaign,
        study,
        nuisances=nuisances,
        library=offered,
        exclude=exclude,
        series=seen.tier == "T" or (cache is not None and cache.series),
        sampling=None if cache is None else cache.sampling,
        threads=threads,
        client=client,
        seed=seed,
    )
    if not simulator.library:
        raise DiagnosisError("no effect is left to look for: exclude fewer")
    folder = None if out is None else _made(Path(out))
    found = diagnose_with(
        simulator,
        seen.campaign,
        tier=seen.tier,
        cache=folder / CACHE_FILE if cache is None and folder is not None else cache,
        budget=Budget(budget_minutes, simulations, draws),
        seed=seed,
        report=_Progress() if progress else None,
        provenance={
            "scene": study.name,
            "left_out": len(given) - len(seen),
            "excluded": sorted(exclude),
            "unavailable": simulator.unavailable,
            "priors": {name: list(ends) for name, ends in sorted((priors or {}).items())},
            "nuisance_priors": [one.to_json() for one in simulator.nuisances],
        },
    )
    if folder is not None:
        found.save(folder)
    return found


def _check_options(
    budget_minutes: float,
    simulations: int | None,
    draws: int | None,
    seed: int,
    threads: int | None,
) -> None:
    if not 0 < budget_minutes < math.inf:
        raise DiagnosisError(
            f"budget_minutes is {budget_minutes}; give a finite number of minutes above 0"
        )
    if simulations is not None and simulations < 1:
        raise DiagnosisError(f"simulations is {simulations}; give at least 1, or a time instead")
    if seed < 0:
        raise DiagnosisError(f"seed is {seed}; give 0 or more")
    if threads is not None and threads < 1:
        raise DiagnosisError(f"threads is {threads}; give at least 1, or leave it out for all")
    if draws is not None and draws < SCHEDULE.fewest_draws:
        raise DiagnosisError(f"draws is {draws}; give at least {SCHEDULE.fewest_draws}")


def _with_priors(
    library: Mapping[str, Effect] | None, priors: Mapping[str, tuple[float, float]]
) -> Mapping[str, Effect] | None:
    from vsr2.effects import effect
    from vsr2.effects import library as known

    if not priors:
        return library
    out = dict(known() if library is None else library)
    for key, (lower, upper) in priors.items():
        name, _, parameter = key.partition(".")
        own = out[name] if name in out else effect(name)
        out[name] = own.with_prior(parameter, lower, upper)
    return out


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DiagnosisError(
            f"{folder}: cannot be used ({error.strerror}); choose another folder"
        ) from error
    return folder


class _Progress:
    """Lines on standard error, at most two a second."""

    def __init__(self) -> None:
        self._last = 0.0
        self._stage = ""

    def __call__(self, stage: str, share: float, leading: Mapping[str, float]) -> None:
        now = time.monotonic()
        if stage == self._stage and now - self._last < 0.5 and share < 1:
            return
        self._last, self._stage = now, stage
        best = ", ".join(
            name if math.isnan(p) else f"{name} {p:.2f}" for name, p in leading.items()
        )
        line = f"vsr2 diagnose: {stage} {share:4.0%}{'; leading: ' + best if best else ''}"
        end = "\n" if share >= 1 or not sys.stderr.isatty() else "\r"
        print(f"{line:<100}", end=end, file=sys.stderr, flush=True)
