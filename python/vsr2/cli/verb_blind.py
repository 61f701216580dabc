"""`vsr2 blind`: make, diagnose and score packs of campaigns whose effect is withheld."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from cyclopts import App, Group, Parameter

from vsr2.blind import PackSettings
from vsr2.blind.form.pack_settings import ENGINES, KINDS, EngineName
from vsr2.blind.pack_diagnoses import BUDGET as USUAL
from vsr2.cli import options as opt
from vsr2.cli.exclusive_options import one_of
from vsr2.codes import Tier
from vsr2.diagnosis import Budget
from vsr2.ensemble import Execution

verbs = App(name="blind")
BUDGET = Group("Budget (one of)", validator=one_of)


def _pack() -> Any:
    """What a pack is made of, as options: the numbers among :class:`PackSettings`."""
    made: list[tuple[str, Any, Any]] = []
    for one in fields(PackSettings):
        if one.name in KINDS:
            shown = f"{one.default}, 0 with --leave-one-out"
            count = Parameter(converter=opt.integer, consume_multiple=1, show_default=shown)
            made.append((one.name, Annotated[tuple[int, ...] | None, count], None))
        elif isinstance(one.default, (bool, float)):
            made.append((one.name, type(one.default), one.default))
        elif isinstance(one.default, int):
            made.append((one.name, opt.Integer, one.default))
    of = [(name, kind, field(default=default)) for name, kind, default in made]
    options = make_dataclass("Pack", of, frozen=True)
    options.__module__, options.__doc__ = __name__, PackSettings.__doc__
    return Parameter(name="*")(options)


PACK: Any = _pack()()
if TYPE_CHECKING:
    from vsr2.blind.form.events import Say

    Pack: TypeAlias = Any
else:
    Pack = type(PACK)


def _settings(made_of: Any, engines: tuple[str, ...], effects: tuple[str, ...]) -> PackSettings:
    """What is asked for.

    Raises:
        BlindError: `vsr2 blind diagnose` would refuse campaigns of this size.
    """
    from vsr2.ensemble.observed.observations import OBSERVED
    from vsr2.errors import BlindError

    chosen = vars(made_of).copy()
    for name, least in {"trials": OBSERVED.least_trials, "motions": OBSERVED.least_motions}.items():
        if chosen[name] < least:
            raise BlindError(
                f"--{name} is {chosen[name]}; `vsr2 blind diagnose` takes campaigns of {least} or "
                "more"
            )
    for kind in KINDS:
        numbers = chosen.pop(kind)
        if numbers:
            chosen[kind] = numbers[0] if len(numbers) == 1 else numbers
        elif chosen["leave_one_out"]:
            chosen[kind] = 0
    return PackSettings(engines=tuple(dict.fromkeys(engines)), effects=effects, **chosen)


@Parameter(name="*")
@dataclass(frozen=True)
class Making:
    """How a pack is made.

    Attributes:
        key: folder of the key, outside OUT/data (default: OUT-key, beside OUT)
        engine: that simulates (may be repeated)
        effect: draw only this effect (may be repeated; default: all)
        seed: of an open pack; the others have theirs from the operating system, so that nobody can
            draw the answer again
    """

    key: Path | None = None
    engine: Annotated[tuple[str, ...], Parameter(choices=ENGINES)] = (EngineName.MUJOCO.value,)
    effect: tuple[str, ...] = ()
    seed: opt.Integer | None = None
    set: opt.Settings = ()


MAKING_OPTIONS = Making()


@verbs.command
def make(
    scene: Path,
    /,
    *,
    out: Path,
    making: Making = MAKING_OPTIONS,
    made_of: Pack = PACK,
    resume: opt.Resume = False,
    quiet: opt.Quiet = False,
) -> int:
    """Draw, simulate and seal a pack.

    Writes OUT/data and the key folder. Stopped, it goes on with --resume. Nothing of a pack is
    replaced.

    Args:
        scene: study with the nominal scene
        out: folder of the pack
    """
    from vsr2.blind import is_begun, make_pack
    from vsr2.errors import BlindError
    from vsr2.report.messages.blind_packs import sealed_pack

    if making.seed is not None and not made_of.development:
        raise BlindError("--seed: only for open packs; add --development, or leave it out")
    settings = _settings(made_of, making.engine, making.effect)
    folder = out.resolve()
    if not folder.name:
        raise BlindError(f"{out}: has no name that the key's folder could have; add --key")
    study = opt.scene(scene, making.set)
    key = making.key or folder.with_name(f"{folder.name}-key")
    if is_begun(key) and not resume:
        raise BlindError(f"{key}: holds the key of a pack; go on with it by --resume")
    made = make_pack(
        study,
        out,
        key,
        settings,
        seed=making.seed,
        say=_progress(quiet),
    )
    if not quiet:
        print(sealed_pack(made, out))
    return 0


def _progress(quiet: bool) -> Say:
    from vsr2.blind.form.events import unheard
    from vsr2.report.messages.blind_packs import event_text

    return unheard if quiet else lambda event: print(event_text(event), flush=True)


@Parameter(name="*")
@dataclass(frozen=True)
class PackEffort:
    """How each diagnosis is made.

    Attributes:
        campaigns: simulated ones of each protocol, 150 at least, which its campaigns share; 48
            without effect are used besides
        budget_minutes: of each diagnosis, for packs whose campaigns have motions of their own
        budget_cpu_minutes: processor time of all threads together in place of wall time
        no_how_far: do not simulate again what is named, to say how far the gap shrinks
        seed: of each diagnosis
    """

    campaigns: Annotated[opt.Integer, Parameter(group=BUDGET)] = USUAL.campaigns or 0
    budget_minutes: Annotated[float | None, Parameter(group=BUDGET)] = None
    budget_cpu_minutes: Annotated[float | None, Parameter(group=BUDGET)] = None
    no_how_far: bool = False
    threads: opt.Threads = None
    scheduler: opt.Scheduler = None
    seed: opt.Integer = 0

    def budget(self) -> Budget:
        """Campaigns, or minutes where they are given."""
        minutes, cpu_minutes = self.budget_minutes, self.budget_cpu_minutes
        held_out = not self.no_how_far
        if cpu_minutes is not None:
            return Budget(cpu_minutes=cpu_minutes, held_out=held_out)
        if minutes is not None:
            return Budget(minutes, held_out=held_out)
        return Budget(campaigns=self.campaigns, held_out=held_out)


EFFORT = PackEffort()


@verbs.command
def diagnose(
    data: Path,
    /,
    *,
    out: Path,
    tier: tuple[Tier, ...] = (),
    campaign: tuple[str, ...] = (),
    effort: PackEffort = EFFORT,
    resume: opt.Resume = False,
    quiet: opt.Quiet = False,
) -> int:
    """Run the diagnosis over a pack's data folder.

    Reads the data folder alone. Stopped, it goes on with --resume; with more campaigns or minutes
    than before that diagnoses all again, and simulates what is missing.

    Args:
        data: a pack's data folder
        out: folder of the diagnoses and of the cache of simulations
        tier: diagnose this tier (may be repeated; default: all)
        campaign: diagnose the campaign with this id (may be repeated; default: all)
    """
    from vsr2.blind import diagnose_pack
    from vsr2.blind.pack_diagnoses import SUBMISSION
    from vsr2.errors import BlindError
    from vsr2.report.messages.blind_packs import diagnosed_pack
    from vsr2.report.messages.progress_lines import ProgressLines

    if (out / SUBMISSION).exists() and not resume:
        raise BlindError(
            f"{out}: holds diagnoses of a pack; go on with --resume, or choose another --out"
        )
    with opt.cluster(effort.scheduler, effort.threads) as client:
        report = None if quiet else ProgressLines("blind diagnose")
        progress = diagnose_pack(
            data,
            out,
            tiers=tier or None,
            campaigns=campaign or None,
            budget=effort.budget(),
            execution=Execution(effort.threads, client, report=report),
            seed=effort.seed,
            say=_progress(quiet),
        )
    if not quiet:
        print(diagnosed_pack(progress, out))
    return 1 if progress.failed else 0


@verbs.command
def score(
    data: Path,
    key: Path,
    diagnoses: Path,
    /,
    *,
    out: Path,
    tier: tuple[Tier, ...] = (),
    train: tuple[Path, Path] | None = None,
    quiet: opt.Quiet = False,
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
    from vsr2.report.blind_page import scores_page, write_scores
    from vsr2.report.messages.written import wrote

    scored = score_pack(
        data, key, diagnoses, out, training=train, tiers=tier or None, say=_progress(quiet)
    )
    write_scores(scored, out)
    if not quiet:
        print(scores_page(scored), end="")
        print(wrote(out))
    return 0
