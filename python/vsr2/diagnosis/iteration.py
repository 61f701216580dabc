"""Diagnosis of the corrected scene, again and again, until nothing is named."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, fields, replace
from enum import StrEnum
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

from vsr2 import _native
from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, Tier, load_campaign
from vsr2.config import Study, dump_study, load_study
from vsr2.diagnosis.api import BUDGET, diagnose
from vsr2.diagnosis.budget import SCHEDULE, Budget
from vsr2.diagnosis.corrected import (
    CORRECTED_FILE,
    DRAWS,
    DRAWS_FOLDER,
    corrected_study,
    scene_head,
)
from vsr2.diagnosis.verdict.document import (
    CHECK_FILES,
    FILE,
    PAGE_FILE,
    SCHEMA,
    TABLES,
    Diagnosis,
)
from vsr2.effects import check_study_effects
from vsr2.effects.own_code import own_code
from vsr2.ensemble.execution import EXECUTION, Execution, made_folder
from vsr2.ensemble.protocol_cache import SIMULATIONS
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.scene_simulator import HYPOTHESES
from vsr2.errors import DiagnosisError
from vsr2.posterior.files import POSTERIORS
from vsr2.results.atomic import write_text

IterationSchema = Literal["vsr2.iteration/1"]
ITERATION_SCHEMA: IterationSchema = get_args(IterationSchema)[0]
ITERATION_FILE = "iteration.json"
_OF_ONE = (
    FILE, PAGE_FILE, *TABLES, CORRECTED_FILE, f"{DRAWS_FOLDER}/{DRAWS}", SIMULATIONS,
    POSTERIORS, *CHECK_FILES,
)  # fmt: skip
WORK_FILES = (ITERATION_FILE, *_OF_ONE, *(f"round_*/{name}" for name in _OF_ONE))
"""Patterns of the files of a diagnosis' folder, of one or of several."""


class Ended(StrEnum):
    """Why no further round was run."""

    NOTHING_NAMED = "nothing_named"
    """The last round names nothing."""
    MOST_ROUNDS = "most_rounds"
    """There were as many as were asked for."""
    NOTHING_CHANGED = "nothing_changed"
    """What the last round names leaves the scene as it is, such as a longer tether."""
    NOT_STATED = "not_stated"
    """No study states what the last round names beside the scene's own effects."""


@dataclass(frozen=True, eq=False)
class Asked:
    """What :func:`vsr2.diagnose` takes beside campaign, scene and folder, in its words."""

    tier: Tier | None = None
    budget: Budget = BUDGET
    hypotheses: Hypotheses = HYPOTHESES
    execution: Execution = EXECUTION
    seed: int = 0


ASKED = Asked()


@dataclass(frozen=True, eq=False)
class Round:
    """One diagnosis of several.

    Attributes:
        folder: of its files.
        scene: that was diagnosed.
        found: its diagnosis; of a round that an earlier run finished without rows of trials and
            samples.
    """

    folder: Path
    scene: Study
    found: Diagnosis


@dataclass(frozen=True, eq=False)
class Iteration:
    """Diagnoses of a scene that each corrects.

    Attributes:
        rounds: in order.
        ended: why there are no more.
        scene: with all that was named.
    """

    rounds: tuple[Round, ...]
    ended: Ended
    scene: Study

    def to_json(self) -> dict[str, Any]:
        """`iteration.json`."""
        return {
            "schema": ITERATION_SCHEMA,
            "campaign": self.rounds[0].found.content["campaign"]["name"],
            "ended": str(self.ended),
            "rounds": [_summary(one) for one in self.rounds],
            "scene": self.scene.effects,
        }

    def save(self, folder: Path) -> None:
        """Write `iteration.json`, and `corrected.yaml` where something was named.

        Raises:
            ResultError: a file cannot be written.
        """
        path = folder / CORRECTED_FILE
        path.unlink(missing_ok=True)
        if self.scene.effects != self.rounds[0].scene.effects:
            head = scene_head({"rounds_of_diagnosis": len(self.rounds)})
            write_text(path, head + dump_study(self.scene, relative_to=folder))
        write_text(folder / ITERATION_FILE, json.dumps(self.to_json(), indent=2) + "\n")


def _summary(one: Round) -> dict[str, Any]:
    content = one.found.content
    gap, corrected = content["gap"], content["corrected"]
    return {
        "folder": one.folder.name,
        "scene": one.scene.effects,
        "verdict": {key: content["verdict"][key] for key in ("kind", "effects", "probability")},
        "corrected": corrected and corrected["effects"],
        "none_probability": content["none_probability"],
        **{key: gap[key] for key in ("before", "floor", "excess", "closure", "headline")},
    }


@checked_names(DiagnosisError)
def iterate(
    campaign: Campaign | str | PathLike[str],
    scene: Study | str | PathLike[str],
    out: str | PathLike[str],
    *,
    asked: Asked = ASKED,
    most: int | None = None,
    finished: Callable[[Diagnosis, Study, Path], object] | None = None,
) -> Iteration:
    """Diagnose a campaign, correct the scene by what is named, and diagnose again.

    A round that is finished and asked the same is not run again. One under way goes on from its
    simulations. References hold for the scene as given, and count in the first round alone.

    Args:
        campaign: as in :func:`vsr2.diagnose`.
        scene: to begin with.
        out: folder of the rounds, `round_1` and so on, of `iteration.json`, and of
            `corrected.yaml` with all that was named.
        asked: of each round.
        most: rounds; None: `ScheduleConstants.rounds`.
        finished: called with the diagnosis, the scene and the folder of a round that was run; the
            round counts as finished afterwards. None: nobody.

    Returns:
        The rounds.

    Raises:
        DiagnosisError: `most` is below 1.
        Vsr2Error: as :func:`vsr2.diagnose` raises them.
    """
    most = SCHEDULE.rounds if most is None else most
    if most < 1:
        raise DiagnosisError(f"most rounds is {most}; give 1 or more")
    given = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
    study = scene if isinstance(scene, Study) else load_study(scene)
    check_study_effects(study.effects, study.name if isinstance(scene, Study) else scene)
    folder = made_folder(Path(out))
    rounds: list[Round] = []
    ended = Ended.MOST_ROUNDS
    while len(rounds) < most:
        below = folder / f"round_{len(rounds) + 1}"
        rounds.append(_round(given, study, below, finished, asked, first=not rounds))
        corrected = corrected_study(rounds[-1].found, study)
        if corrected is None:
            named = rounds[-1].found.content["corrected"] is not None
            ended = Ended.NOT_STATED if named else Ended.NOTHING_NAMED
            break
        if corrected == study:
            ended = Ended.NOTHING_CHANGED
            break
        study = corrected
        # What a diagnosis did of another scene says nothing of this one.
        asked = replace(
            asked,
            hypotheses=replace(asked.hypotheses, references=()),
            budget=replace(asked.budget, simulator=""),
        )
    done = Iteration(tuple(rounds), ended, study)
    done.save(folder)
    return done


def _round(
    campaign: Campaign,
    study: Study,
    folder: Path,
    finished: Callable[[Diagnosis, Study, Path], object] | None,
    asked: Asked,
    *,
    first: bool,
) -> Round:
    """A diagnosis, or what an earlier run finished of the same."""
    digest = _digest(campaign, study, asked)
    known = _finished(folder, study, digest)
    if known is not None:
        return Round(folder, study, known)
    if not first:
        # The rounds before may have named other effects: then it is of another scene.
        (folder / FILE).unlink(missing_ok=True)
    found = diagnose(campaign, study, out=folder, **vars(asked))
    if finished is not None:
        finished(found, study, folder)
    # Last of all, so that what counts as finished is.
    content = json.loads((folder / FILE).read_text(encoding="utf-8"))
    content["provenance"]["asked"] = digest
    write_text(folder / FILE, json.dumps(content, indent=2, allow_nan=False) + "\n")
    return Round(folder, study, found)


def _finished(folder: Path, study: Study, digest: str) -> Diagnosis | None:
    """A finished diagnosis; None: there is none of the same, or not all that is read of it."""
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        same = content["provenance"]["asked"] == digest
        found = Diagnosis(content)
        if same:
            _summary(Round(folder, study, found))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return found if same else None


def _digest(campaign: Campaign, study: Study, asked: Asked) -> str:
    """Hash of all that a diagnosis depends on, but for where and how it runs."""
    digest = hashlib.sha256()
    for part in _content(campaign, study, asked):
        digest.update(part + b"\0")
    return digest.hexdigest()


def _content(campaign: Campaign, study: Study, asked: Asked) -> Iterator[bytes]:
    hypotheses = asked.hypotheses
    drawn = (*hypotheses.nuisances, *hypotheses.contact_family)
    yield repr(
        (
            SCHEMA,
            str(_native.build_facts()["version"]),
            study.model_dump_json(),
            asked.tier,
            astuple(asked.budget),
            asked.seed,
            sorted(hypotheses.exclude),
            hypotheses.ends,
            [(name, own_code(type(one))) for name, one in hypotheses.offered.items()],
            [one.identity for one in drawn],
        )
    ).encode()
    for one in (campaign, *hypotheses.references):
        yield from _measured(one)


def _measured(campaign: Campaign) -> Iterator[bytes]:
    """All that a campaign's trials, series and motions hold."""
    yield repr((campaign.name, campaign.noise)).encode()
    for trial in campaign.trials:
        yield repr(replace(trial, series=None)).encode()
        if trial.series is not None:
            yield from _arrays(trial.series)
    for name, record in sorted(campaign.motions.items()):
        yield name.encode()
        yield from _arrays(record)


def _arrays(of: Any) -> Iterator[bytes]:
    """Fields of a dataclass, arrays by their bytes."""
    for field in fields(of):
        value = getattr(of, field.name)
        array = getattr(value, "tobytes", None)
        yield field.name.encode() + (repr(value).encode() if array is None else array())
