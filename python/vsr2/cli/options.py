"""Options that recur, each defined once, and what the verbs that take them share."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, get_origin

from cyclopts import Group, Parameter, Token

from vsr2.cli.exclusive_options import one_of

if TYPE_CHECKING:
    import distributed

    from vsr2.config import Study as StudySettings
    from vsr2.ensemble import Execution, Nuisance
    from vsr2.ensemble.simulated.distributions import Distribution
    from vsr2.results import BatchResult

    Prior = Distribution | tuple[float, float]


def _shown(default: object) -> str | None:
    if isinstance(default, tuple):
        return ", ".join(map(str, default)) or None
    return None if default is None or default is False else str(default)


DEFAULTS = Parameter(negative=(), allow_repeating=True, show_default=_shown)
"""For all verbs: no `--no-OPTION`; of a value given twice the last counts."""


def integer(kind: Any, tokens: Sequence[Token]) -> int | tuple[int, ...]:
    """Whole numbers; the library's own converter would round 2.6 to 3."""
    try:
        numbers = tuple(int(token.value) for token in tokens)
    except ValueError:
        given = " ".join(token.value for token in tokens)
        raise ValueError(f'"{given}" is no whole number') from None
    return numbers if get_origin(kind) is tuple else numbers[0]


def positive_integer(kind: Any, tokens: Sequence[Token]) -> int:
    """A whole number of 1 or more."""
    number = integer(kind, tokens)
    if not (isinstance(number, int) and number >= 1):
        raise ValueError(f'"{number}" is not 1 or more')
    return number


Integer = Annotated[int, Parameter(converter=integer)]
Study = Annotated[Path, Parameter(help="study to run")]
Campaign = Annotated[Path, Parameter(help="folder of a campaign")]
Settings = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set",
        help="change one key of the study: KEY=VALUE, for example seed=7 (may be repeated)",
    ),
]
Nuisances = Annotated[
    tuple[str, ...],
    Parameter(
        name="--nuisance",
        help="standard deviation of what is uncertain of the set-up, NAME=SD, for example "
        "friction=0.05 (may be repeated; names and defaults: docs/explanation/inference.md)",
    ),
]
Excluded = Annotated[
    tuple[str, ...],
    Parameter(name="--exclude", help="leave this effect out (may be repeated)"),
]
Priors = Annotated[
    tuple[str, ...],
    Parameter(
        name="--prior",
        help="another prior: its ends, EFFECT.PARAMETER=LOW:HIGH, as time_scale.change=-0.3:0.1, "
        "or a distribution, =uniform:LOW:HIGH, =loguniform:LOW:HIGH, =normal:MEAN:SD (may be "
        "repeated)",
    ),
]
Threads = Annotated[
    int | None,
    Parameter(converter=positive_integer, help="default: all processors that this process may use"),
]
Scheduler = Annotated[
    str | None,
    Parameter(
        help="run on the Dask cluster of this scheduler, for example tcp://10.0.0.1:8786, or its "
        "scheduler file (.json)"
    ),
]
THERE = Group("What is there already (one of)", validator=one_of)
Overwrite = Annotated[bool, Parameter(group=THERE, help="replace what is there")]
Resume = Annotated[
    bool, Parameter(group=THERE, help="go on with what is there, unfinished work on the same")
]
Json = Annotated[bool, Parameter(help="print JSON")]
Quiet = Annotated[bool, Parameter(help="no progress, no summary")]


class Again(Protocol):
    """Options of a verb whose work may be there already."""

    @property
    def overwrite(self) -> bool:
        """Replace it."""

    @property
    def resume(self) -> bool:
        """Go on with it."""


class Work(Protocol):
    """Options of a verb that simulates trials of a campaign again."""

    @property
    def threads(self) -> int | None:
        """None: all processors."""

    @property
    def cache(self) -> Path | None:
        """Folder of simulations; None: they are kept in memory, or in the output folder."""

    @property
    def quiet(self) -> bool:
        """No progress."""


WHERE = Group("Where trials run (one of)", validator=one_of)


@Parameter(name="*")
@dataclass(frozen=True)
class StudyRun:
    """Options of every run of a study into a folder.

    Attributes:
        out: output folder (default: out/NAME of the study)
        no_figures: write no figures, no page
    """

    out: Path | None = None
    overwrite: Overwrite = False
    resume: Resume = False
    threads: Threads = None
    scheduler: Annotated[Scheduler, Parameter(group=WHERE)] = None
    set: Settings = ()
    no_figures: bool = False
    quiet: Quiet = False

    def folder(self, name: str) -> Path:
        """The output folder of a study with this name."""
        return self.out or Path("out") / name


RUN = StudyRun()


def scene(path: Path, settings: tuple[str, ...]) -> StudySettings:
    """The study of a scene, with what `--set` changes, its effects checked.

    Raises:
        ConfigError: it cannot be used.
    """
    from vsr2.config import load_study
    from vsr2.effects import check_study_effects

    study = load_study(path, overrides=settings)
    check_study_effects(study.effects, path)
    return study


@contextmanager
def cluster(address: str | None, threads: int | None = None) -> Iterator[distributed.Client | None]:
    """The client of a Dask scheduler, or None where no address is given.

    Raises:
        SimulationError: the scheduler cannot be reached, or threads are given beside it.
    """
    from vsr2.errors import SimulationError
    from vsr2.simulation import connect

    if address is None:
        yield None
        return
    if threads is not None:
        raise SimulationError("--threads does not apply with --scheduler: workers have their own")
    with connect(address) as client:
        yield client


def work_folder(folder: Path, own: Sequence[str], what: str, options: Again) -> None:
    """Make a folder ready in which work goes on; see :func:`vsr2.results.prepare_work_folder`.

    One that is not there is left to whoever does the work: what is asked for may still be refused.
    """
    from vsr2.results import prepare_work_folder

    if folder.exists():
        prepare_work_folder(folder, own, what, overwrite=options.overwrite, resume=options.resume)


def execution(
    options: Work,
    client: distributed.Client | None,
    verb: str,
    notes: Mapping[str, Any] | None = None,
) -> Execution:
    """How a verb of a diagnosis simulates, what it keeps and notes, and how it reports progress."""
    from vsr2.ensemble import Execution, ProtocolCache
    from vsr2.report.messages.progress_lines import ProgressLines

    return Execution(
        options.threads,
        client,
        None if options.cache is None else ProtocolCache(options.cache),
        report=None if options.quiet else ProgressLines(verb),
        notes={} if notes is None else notes,
    )


def exit_code(result: BatchResult) -> int:
    """0, or 1 where some trials have no trustworthy outcome."""
    from vsr2.results import Status

    return 0 if set(result["status"]) <= {Status.ok} else 1


def has_all_logs(folder: Path, *, npy: bool, remake: bool = True) -> bool:
    """Whether a finished result has its logs; one that lost some is made ready to go on.

    Args:
        folder: of the result.
        npy: whether the original's rows belong to it.
        remake: whether trials may be run.

    Raises:
        ResultError: logs are lost and no trials may be run, or the result cannot be read.
    """
    from vsr2.errors import ResultError
    from vsr2.report.messages.commands import merged_logs_lost
    from vsr2.results import lost_logs, reopen_result

    lost = lost_logs(folder, npy=npy)
    if lost and not remake:
        raise ResultError(merged_logs_lost(folder, lost))
    if lost:
        reopen_result(folder, lost)
    return not lost


def nothing_to_do(folder: Path, *, quiet: bool) -> int:
    """Say that a folder holds the finished result that is asked for; returns its exit code."""
    from vsr2.report.messages.commands import finished_before
    from vsr2.results import load_result

    result = load_result(folder, logs=False)
    if not quiet:
        print(finished_before(folder, len(result)))
    return exit_code(result)


def interrupted(result: BatchResult, folder: Path) -> int:
    """Say what of an interrupted batch is kept; returns the exit code."""
    import sys

    from vsr2.report.messages.commands import interrupted_batch

    print(f"vsr2: {interrupted_batch(result, folder)}", file=sys.stderr)
    return 130


def target_file(path: Path, *, overwrite: bool) -> Path:
    """A file that is to be written, its folder made where it is not there.

    Raises:
        ResultError: it exists and is not to be replaced, or the folder cannot be made.
    """
    from vsr2.errors import ResultError

    if path.exists() and not overwrite:
        raise ResultError(f"{path}: exists; choose another --out, or add --overwrite")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(
            f"{path}: its folder cannot be made ({error.strerror}); choose another path"
        ) from error
    return path


def print_json(value: object) -> None:
    """Print plain data or dataclasses as JSON; null for NaN, which JSON does not know."""
    from pydantic_core import to_json

    print(to_json(value, indent=2, inf_nan_mode="null").decode())


def print_written(paths: Sequence[Path]) -> None:
    """List files and folders that a verb wrote."""
    print("wrote:")
    for path in paths:
        print(f"  {path}")


def nuisances(texts: tuple[str, ...]) -> tuple[Nuisance, ...]:
    """What is uncertain of the set-up, some of it as the command line says.

    Raises:
        ConfigError: no NAME=SD, an unknown name, or one that is given twice.
    """
    from vsr2.ensemble import DEFAULT_NUISANCES, with_deviations
    from vsr2.errors import ConfigError, DiagnosisError
    from vsr2.near_words import nearest

    given: dict[str, float] = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            deviation = float(number)
            with_deviations({name: deviation})
        except (ValueError, DiagnosisError) as error:
            known = [one.name for one in DEFAULT_NUISANCES]
            if name in known and isinstance(error, DiagnosisError) and float(number) >= 0:
                raise ConfigError(f"--nuisance {text}: {error.message}") from None
            near = None if name in known else nearest(name, known)
            remedy = f"did you mean {near}?" if near else f"names are {', '.join(known)}"
            raise ConfigError(
                f"--nuisance {text}: give NAME=SD with a number of 0 or more; {remedy}"
            ) from None
        if name in given:
            raise ConfigError(
                f"--nuisance {text}: {name} has {given[name]:g} already; give one of them"
            )
        given[name] = deviation
    return with_deviations(given)


def priors(texts: tuple[str, ...], excluded: Collection[str] = ()) -> dict[str, Prior]:
    """Several of them.

    Args:
        texts: as given.
        excluded: effects that are not looked for.

    Raises:
        ConfigError: one is no prior or of an effect that is excluded, or two are of one parameter.
    """
    from vsr2.errors import ConfigError

    given: dict[str, tuple[str, Prior]] = {}
    for text in texts:
        key, value = prior(text)
        if key in given:
            raise ConfigError(
                f"--prior {text}: {key} has {given[key][0].partition('=')[2]} already; give one of "
                "them"
            )
        if key.partition(".")[0] in excluded:
            raise ConfigError(
                f"--prior {key}: its effect is not looked for (--exclude); leave one of them out"
            )
        given[key] = text, value
    return {key: value for key, (_, value) in given.items()}


def prior(text: str) -> tuple[str, Prior]:
    """A prior of the command line, by `effect.parameter`.

    Raises:
        ConfigError: it is no prior.
    """
    from vsr2.ensemble import LogUniform, Normal, Uniform
    from vsr2.errors import ConfigError

    key, _, given = text.partition("=")
    *shape, one, other = ["", *given.split(":")]
    try:
        numbers = float(one), float(other)
        if "." not in key:
            raise ValueError
        match shape:
            case [""]:
                return key, numbers
            case ["", "uniform"]:
                return key, Uniform(*numbers)
            case ["", "loguniform"]:
                return key, LogUniform(*numbers)
            case ["", "normal"]:
                return key, Normal(mean=numbers[0], sd=numbers[1])
        raise ValueError
    except ValueError:
        raise ConfigError(
            f"--prior {text}: give EFFECT.PARAMETER=LOW:HIGH, as time_scale.change=-0.3:0.1, or a "
            "distribution: =uniform:LOW:HIGH, =loguniform:LOW:HIGH, =normal:MEAN:SD"
        ) from None
