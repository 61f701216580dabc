"""`vsr2 blind`: make, diagnose and score packs of campaigns whose effect is withheld."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Group, Parameter
from cyclopts.validators import mutually_exclusive

from vsr2.blind import DiagnosisOptions, PackSettings
from vsr2.blind.form.pack_settings import ENGINES, KINDS
from vsr2.blind.pack_diagnoses import CAMPAIGNS
from vsr2.cli import options as opt

verbs = App(name="blind")
BUDGET = Group("Budget (one of)", validator=mutually_exclusive)


def _count(default: object) -> Parameter:
    shown = f"{default}, 0 with --leave-one-out"
    return Parameter(converter=opt.whole, consume_multiple=1, show_default=shown)


@Parameter(name="*")
@dataclass(frozen=True)
class Pack:
    """What a pack is made of.

    Attributes:
        single: campaigns with one effect; for each engine, or one number for all
        none: campaigns without any; likewise
        pair: campaigns with two effects; likewise
        unknown: campaigns whose effect the diagnosis may not use; likewise
        leave_one_out: so many campaigns of kind unknown for every effect that reaches its
            detection limit, beside what is asked for of the kinds
        trials: trials a campaign
        motions: ground motions a campaign
        sessions: sessions a campaign
        catalogue: ground motions of the pack
        protocols: of the pack: campaigns of one share amplitudes, order and motions
        hidden: effect classes that may be left out of the library
        replicates: draws of nuisances with and without an effect that measure its signal
        signal_trials: trials on which signals are measured
        series_interval: of the series [s]; 0: none, tiers B and M alone
        development: an open pack: scored as often as you like
    """

    single: Annotated[tuple[int, ...] | None, _count(PackSettings.single)] = None
    none: Annotated[tuple[int, ...] | None, _count(PackSettings.none)] = None
    pair: Annotated[tuple[int, ...] | None, _count(PackSettings.pair)] = None
    unknown: Annotated[tuple[int, ...] | None, _count(PackSettings.unknown)] = None
    leave_one_out: opt.Integer | None = None
    trials: opt.Integer = PackSettings.trials
    motions: opt.Integer = PackSettings.motions
    sessions: opt.Integer = PackSettings.sessions
    catalogue: opt.Integer = PackSettings.catalogue
    protocols: opt.Integer = PackSettings.protocols
    hidden: opt.Integer = PackSettings.hidden
    replicates: opt.Integer = PackSettings.replicates
    signal_trials: opt.Integer = PackSettings.signal_trials
    series_interval: float = PackSettings.series_interval
    development: bool = False

    def values(self) -> dict[str, Any]:
        """As :class:`PackSettings` takes them.

        Raises:
            BlindError: `vsr2 blind diagnose` would refuse campaigns of this size.
        """
        from vsr2.diagnosis.observed.observations import OBSERVED
        from vsr2.errors import BlindError

        least_of = {"trials": OBSERVED.least_trials, "motions": OBSERVED.least_motions}
        for name, least in least_of.items():
            if (given := getattr(self, name)) < least:
                raise BlindError(
                    f"--{name} is {given}; `vsr2 blind diagnose` takes campaigns of {least} or more"
                )
        chosen = {name: value for name, value in asdict(self).items() if value is not None}
        for kind in KINDS:
            if numbers := getattr(self, kind):
                chosen[kind] = numbers[0] if len(numbers) == 1 else numbers
            elif self.leave_one_out is not None:
                chosen[kind] = 0
        return chosen


PACK = Pack()


@verbs.command
def make(
    scene: Path,
    pack: Path,
    /,
    *,
    key: Path | None = None,
    engine: Annotated[tuple[str, ...], Parameter(choices=ENGINES)] = ("mujoco",),
    made_of: Pack = PACK,
    effect: tuple[str, ...] = (),
    seed: opt.Integer | None = None,
    quiet: opt.Quiet = False,
) -> int:
    """Draw, simulate and seal a pack.

    Writes PACK/data and the key folder. Stopped, the same command continues.

    Args:
        scene: study with the nominal scene
        pack: folder of the pack
        key: folder of the key, outside PACK/data (default: PACK-key, beside PACK)
        engine: that simulates (may be repeated)
        effect: draw only this effect (may be repeated; default: all)
        seed: of an open pack; the others have theirs from the operating system, so that nobody can
            draw the answer again
    """
    from vsr2.blind import make_pack
    from vsr2.config import load_study
    from vsr2.errors import BlindError
    from vsr2.report.messages.commands import sealed_pack

    if seed is not None and not made_of.development:
        raise BlindError("--seed: only for open packs; add --development, or leave it out")
    settings = PackSettings(
        engines=tuple(dict.fromkeys(engine)), effects=effect, **made_of.values()
    )
    folder = pack.resolve()
    if not folder.name:
        raise BlindError(f"{pack}: has no name that the key's folder could have; add --key")
    made = make_pack(
        load_study(scene),
        pack,
        key or folder.with_name(f"{folder.name}-key"),
        settings,
        seed=seed,
        say=_progress(quiet),
    )
    print(sealed_pack(made, pack))
    return 0


def _progress(quiet: bool) -> Callable[[str], None]:
    return (lambda text: None) if quiet else (lambda text: print(text, flush=True))


@Parameter(name="*")
@dataclass(frozen=True)
class Effort:
    """How each diagnosis is made.

    Attributes:
        campaigns: simulated ones of each protocol, which its campaigns share
        budget_minutes: of each diagnosis, for packs whose campaigns have motions of their own
        seed: of each diagnosis
    """

    campaigns: Annotated[opt.Integer, Parameter(group=BUDGET)] = CAMPAIGNS
    budget_minutes: Annotated[float | None, Parameter(group=BUDGET)] = None
    threads: opt.Threads = None
    seed: opt.Integer = 0

    def options(self) -> DiagnosisOptions:
        """As :func:`vsr2.blind.diagnose_pack` takes them."""
        if self.budget_minutes is None:
            return DiagnosisOptions(campaigns=self.campaigns, threads=self.threads, seed=self.seed)
        return DiagnosisOptions(None, self.budget_minutes, self.threads, self.seed)


EFFORT = Effort()


@verbs.command
def diagnose(
    data: Path,
    /,
    *,
    out: Path,
    tier: tuple[opt.Tier, ...] = (),
    campaign: tuple[str, ...] = (),
    effort: Effort = EFFORT,
    quiet: opt.Quiet = False,
) -> int:
    """Run the diagnosis over a pack's data folder.

    Reads the data folder alone. Stopped, the same command continues.

    Args:
        data: a pack's data folder
        out: folder of the diagnoses and of the cache of simulations
        tier: diagnose this tier (may be repeated; default: all)
        campaign: diagnose the campaign with this id (may be repeated; default: all)
    """
    from vsr2.blind import diagnose_pack

    progress = diagnose_pack(
        data,
        out,
        tiers=tier or None,
        campaigns=campaign or None,
        options=effort.options(),
        say=_progress(quiet),
    )
    print(f"{out}: {progress.done} diagnoses, {len(progress.failed)} failed")
    return 1 if progress.failed else 0


@verbs.command
def score(
    data: Path,
    key: Path,
    diagnoses: Path,
    /,
    *,
    out: Path,
    tier: tuple[opt.Tier, ...] = (),
    train: tuple[Path, Path] | None = None,
) -> int:
    """Open the key and score the diagnoses, once.

    Verifies the hashes of key and data, writes scores.json, scores.md and reliability.png, and
    leaves a receipt in the key folder: from then on no other diagnoses of the pack are scored.

    Args:
        data: a pack's data folder
        key: its key folder
        diagnoses: what `vsr2 blind diagnose` wrote
        out: folder that gets the scores
        tier: score this tier alone (may be repeated; default: all of the pack, which must have
            been diagnosed)
        train: DATA KEY: a development pack that trains the trivial baselines
    """
    from vsr2.blind import score_pack
    from vsr2.blind.scoring.tables import format_scores

    scored = score_pack(
        data, key, diagnoses, out, training=train, tiers=tier or None, say=_progress(False)
    )
    print(format_scores(scored), end="")
    print(f"wrote {out}")
    return 0
