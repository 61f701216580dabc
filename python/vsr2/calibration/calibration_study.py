"""The calibration study: a study's scene, a campaign, parameters with ranges, and a method."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, Strict, model_validator

from vsr2.analysis.baseline import LOGISTIC
from vsr2.analysis.intervals import INTERVALS
from vsr2.calibration.objective import Objective
from vsr2.config.extended import ExtendedStudy, Plain, load_extended
from vsr2.config.motion_source import AllRecordings
from vsr2.config.problems import shown
from vsr2.config.schema import extended_schema
from vsr2.config.section import FilePath, NonNegative, Real, Section
from vsr2.config.sources import (
    OFF,
    POWER_OF_TWO,
    PROFILE,
    REFINE,
    REPLICATES,
    RESAMPLES,
    SMALLEST_GAIN,
    SUPPLEMENT_SEARCH,
    TEN_FOLDS,
)
from vsr2.effects import check_study_effects
from vsr2.errors import ConfigError

Value = (
    Annotated[bool, Strict()]
    | Annotated[int, Strict()]
    | Annotated[float, Strict()]
    | Annotated[str, Strict(), Field(max_length=200)]
)
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=60)]
Key = Annotated[str, Field(pattern=r"^[a-z_0-9]+(\.[a-z_0-9]+)*$", max_length=200)]


@dataclass(frozen=True)
class CalibrationConstants:
    """What a calibration's study does not state; chosen by hand.

    Attributes:
        first_deviation: standard deviation from which the evolution strategy starts, over the range
            of each parameter.
        cells: into which a range is cut, where no profile points are tried: as many as are tried by
            default.
        baseline_folds: of the baselines, where the study asks for no folds: its own default.
    """

    first_deviation: float = 0.2
    cells: int = 7
    baseline_folds: int = LOGISTIC.folds


CALIBRATION = CalibrationConstants()
MOTION_KEYS = ("drive", "channel", "filter", "scale")
"""Keys of `motion` in a calibration study; the motions themselves are the campaign's."""
RESERVED = (
    "iteration", "group", "accuracy", "precision", "recall", "f1", "objective", "failed",
    "fold", "trials", "training", "held_out", "evaluation", "stage",
)  # fmt: skip
"""Columns of the tables, which no parameter may be named after."""


class CalibrationParameter(Section):
    """What is varied: one value for one key of the study, or for several that are tied."""

    keys: Annotated[tuple[Key, ...], Field(min_length=1, max_length=20)]
    """Dotted keys of the study; all get the same value."""
    range: tuple[Real, Real] | None = None
    """Lowest and highest value; give this or `values`."""
    scale: Literal["linear", "log"] = "linear"
    """How a range is divided."""
    values: Annotated[tuple[Value, ...], Field(min_length=2, max_length=200)] | None = None
    """A list of numbers or words to choose from; give this or `range`."""
    unit: Annotated[str, Field(max_length=20)] = ""
    """For tables and figures."""

    @model_validator(mode="after")
    def _one_of_range_and_values(self) -> Self:
        if (self.range is None) == (self.values is None):
            raise ValueError("give exactly one of `range` and `values`")
        if self.range is not None:
            low, high = self.range
            if not low < high:
                raise ValueError(f"range: {low} must be below {high}")
            if self.scale == "log" and low <= 0:
                raise ValueError(f"range: starts at {low}; a log scale needs it above 0")
        elif self.scale == "log":
            raise ValueError("scale: divides a range; remove it beside `values`")
        if self.values is not None and len(set(map(repr, self.values))) != len(self.values):
            raise ValueError("values: one is there twice; remove it")
        return self


class Sequential(Section):
    """The supplement's procedure (S3): one parameter at a time, best value carried forward."""

    kind: Literal["sequential"]
    max_iterations: Annotated[int, Strict(), Field(ge=1, le=100), SUPPLEMENT_SEARCH] = 10
    """Iterations at most, each over all parameters."""
    min_gain: Annotated[NonNegative, SMALLEST_GAIN] = 0.0005
    """An iteration that raises the objective by no more than this is the last."""


class Joint(Section):
    """All parameters together: a design that fills the ranges, then proposals of a search."""

    kind: Literal["joint"]
    design: Annotated[int, Strict(), Field(ge=2, le=100_000), POWER_OF_TWO] = 64
    """Parameter sets that fill the ranges evenly, which know no outcomes and serve all folds."""
    sets: Annotated[tuple[dict[Name, Value], ...], Field(max_length=10_000)] = ()
    """Further sets to try, such as starts that statics suggests; parameters that one leaves out
    have the study's own value. They serve all folds, so choose them without a look at outcomes."""
    refine: Annotated[int, Strict(), Field(ge=0, le=100_000), REFINE] = 24
    """Parameter sets that the search adds, for all trials and again for each fold."""
    proposals: Literal["tpe", "cma"] = "tpe"
    """`tpe`: tree-structured Parzen estimator (optuna); also for lists of words. `cma`: evolution
    strategy with adapted covariance (cma); for ranges alone, and hundreds of sets."""
    profile_points: Annotated[int, Strict(), Field(ge=0, le=200), PROFILE] = 7
    """Values of each parameter that are tried with all others at their best; 0: none."""
    screen: Annotated[int, Strict(), Field(ge=0, le=100_000), OFF] = 0
    """The first so many sets, of the design and then of `sets`, are run on all trials; trials which
    end alike in all of these are taken to do so in the other sets, too. The chosen sets are run on
    all trials in the end. 0: all sets are run on all trials."""

    @model_validator(mode="after")
    def _screen_fits(self) -> Self:
        if self.screen == 1:
            raise ValueError("screen: one set ends like itself; give 2 or more, or 0")
        if self.screen > self.design + len(self.sets):
            raise ValueError(
                f"screen ({self.screen}) is more than design ({self.design}) and sets "
                f"({len(self.sets)}) together"
            )
        return self


class CalibrationSettings(Section):
    """The keys of a calibration study beside a study's own."""

    campaign: FilePath
    """Folder of the campaign to match."""
    parameters: Annotated[dict[Name, CalibrationParameter], Field(min_length=1, max_length=50)]
    """What is varied, in the order in which the sequential procedure takes it."""
    method: Annotated[Sequential | Joint, Field(discriminator="kind")]
    """How the best values are sought."""
    folds: Annotated[int, Strict(), Field(ge=0, le=1000), TEN_FOLDS] = 10
    """Folds by motion, each judged with values chosen without it; 0: in sample alone."""
    resamples: Annotated[int, Strict(), Field(ge=100, le=100_000), RESAMPLES] = INTERVALS.replicates
    """Bootstrap replicates over motions."""
    replicates: Annotated[int, Strict(), Field(ge=1, le=99), REPLICATES] = 5
    """Simulations of each trial under each set. Each draws placement, motion noise, contact model
    and what else is uncertain of a set-up, as `vsr2 campaign predict` does, and sets are judged by
    the probability of overturning. 1: one simulation as the study has it, as in the supplement;
    where outcomes are chaotic, a set may then win by luck."""
    objective: Objective = Objective.MEAN_OF_THREE
    """What the search maximises: `mean_of_three`, of accuracy, precision and recall of the outcomes
    at 0.5; or `log_loss`, of the probabilities, which needs replicates."""
    judged_with: Annotated[dict[Key, Value], Field(max_length=20)] = Field(default_factory=dict)
    """Values of dotted keys of the study with which the chosen sets are judged, after a search
    without them; `{engine.mode: exact}` after a search with the fast engine, for example."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        evolution = isinstance(self.method, Joint) and self.method.proposals == "cma"
        if evolution and len(self.parameters) < 2:
            raise ValueError("method.proposals: `cma` needs two parameters; set it to `tpe`")
        if self.objective is Objective.LOG_LOSS and self.replicates < 2:
            raise ValueError(
                "objective: `log_loss` is of probabilities; give replicates of 2 or more"
            )
        if self.folds == 1:
            raise ValueError("folds: 1 leaves nothing to choose with; give 2 or more, or 0")
        for name, parameter in self.parameters.items():
            if name in RESERVED:
                raise ValueError(f"parameters.{name}: is a column of the tables; rename it")
            if evolution and parameter.values is not None:
                raise ValueError(
                    f"parameters.{name}: method.proposals `cma` goes over ranges; give `range`, or "
                    "set it to `tpe`"
                )
            if isinstance(self.method, Sequential) and parameter.values is None:
                raise ValueError(
                    f"parameters.{name}: the sequential procedure goes over a list; give `values`"
                )
        keys = [key for parameter in self.parameters.values() for key in parameter.keys]
        both = [key for key in self.judged_with if key in keys]
        if both:
            raise ValueError(f"judged_with: {both[0]} is a parameter, which the search chooses")
        double = {key for key in keys if keys.count(key) > 1}
        if double:
            raise ValueError(f"parameters: {min(double)} is varied twice; leave it to one")
        return self


CalibrationStudy = ExtendedStudy[CalibrationSettings]


def calibration_schema() -> dict[str, Any]:
    """The JSON schema of a calibration study, for editors that check and complete YAML."""
    schema = extended_schema(CalibrationSettings, "VSR2 calibration study")
    recordings = schema["$defs"][AllRecordings.__name__]["properties"]
    schema["properties"]["motion"] = {
        "type": "object",
        "description": "How the campaign's motions drive the pedestal.",
        "properties": {key: recordings[key] for key in MOTION_KEYS},
        "additionalProperties": False,
    }
    schema["required"].remove("motion")
    return schema


def load_calibration(
    path: str | os.PathLike[str], *, overrides: Sequence[str] = ()
) -> CalibrationStudy:
    """Read a calibration study.

    Its `motion` holds `drive`, `channel`, `filter` and `scale` of a study alone: the motions are
    those measured in the campaign.

    Args:
        path: YAML file; paths in it are relative to its folder.
        overrides: as in :func:`vsr2.config.load_study`.

    Raises:
        ConfigError: what is wrong, by file, line and key; also a parameter whose key the study has
            not, or one of whose values it refuses.
    """
    complete = partial(_with_motions, label=os.fspath(path))
    study = load_extended(path, CalibrationSettings, overrides=overrides, complete=complete)
    check_study_effects(study.study.effects, study.label)
    _check_sets(study)
    for name, parameter in study.own.parameters.items():
        _check(study, name, parameter)
    for key in study.own.judged_with:
        study.value(key)
    label = f"{study.label}: judged_with"
    check_study_effects(study.with_values(study.own.judged_with, label=label).effects, label)
    return study


def campaign_folder(study: CalibrationStudy) -> Path:
    """The campaign's folder, absolute."""
    return study.base / study.own.campaign


def _with_motions(
    mapping: dict[str, Any], own: CalibrationSettings, base: Path, *, label: str
) -> None:
    given = mapping.get("motion", {})
    if not isinstance(given, dict):
        raise ConfigError(
            f"{label}: motion: must hold the keys {', '.join(MOTION_KEYS)} (is {shown(given)})"
        )
    odd = [key for key in given if key not in MOTION_KEYS]
    if odd:
        raise ConfigError(
            f"{label}: motion.{odd[0]}: has no place in a calibration, whose motions are those of "
            f"the campaign; it takes {', '.join(MOTION_KEYS)}"
        )
    folder = base / own.campaign
    if not folder.is_dir():
        raise ConfigError(
            f"{label}: campaign: no such folder ({folder}); correct the path, or make one with "
            "`vsr2 campaign`"
        )
    mapping["motion"] = {"mode": "all_recordings", "folder": str(folder), **given}


def _check(study: CalibrationStudy, name: str, parameter: CalibrationParameter) -> None:
    at = [study.value(key) for key in parameter.keys]
    if len(set(map(repr, at))) > 1:
        raise ConfigError(
            f"{study.label}: parameters.{name}: the tied keys have the values "
            f"{', '.join(map(shown, at))} in the study; make them equal"
        )
    tried: Sequence[Plain] = parameter.range or parameter.values or ()
    for value in tried:
        label = f"{study.label}: parameters.{name} at {shown(value)}"
        changed = study.with_values(dict.fromkeys(parameter.keys, value), label=label)
        check_study_effects(changed.effects, label)


def _check_sets(study: CalibrationStudy) -> None:
    method = study.own.method
    for i, given in enumerate(method.sets if isinstance(method, Joint) else ()):
        odd = [name for name in given if name not in study.own.parameters]
        if odd:
            known = ", ".join(study.own.parameters)
            raise ConfigError(
                f"{study.label}: method.sets.{i}.{odd[0]}: is no parameter; known are {known}"
            )
        for name, value in (start_values(study) | given).items():
            if not within(study.own.parameters[name], value):
                raise ConfigError(
                    f"{study.label}: method.sets.{i}.{name}: {shown(value)} lies outside the "
                    "parameter's range"
                )


def start_values(study: CalibrationStudy) -> dict[str, Plain]:
    """The study's own value of each parameter."""
    return {name: study.value(one.keys[0]) for name, one in study.own.parameters.items()}


def study_values(study: CalibrationStudy, values: dict[str, Plain]) -> dict[str, Plain]:
    """Values by parameter as values by dotted key."""
    return {key: value for name, value in values.items() for key in study.own.parameters[name].keys}


def within(parameter: CalibrationParameter, value: Plain) -> bool:
    """Whether a value lies in the parameter's range, or is one of its values."""
    if parameter.values is not None:
        return value in parameter.values
    assert parameter.range is not None
    low, high = parameter.range
    return isinstance(value, (int, float)) and low <= value <= high


def at_share(parameter: CalibrationParameter, share: float) -> Plain:
    """The value at a share from 0 to 1 of the parameter's range, or of its list of values.

    Values of a range are rounded to six digits, so that tables give them in full.
    """
    if parameter.values is not None:
        count = len(parameter.values)
        return parameter.values[min(count - 1, int(share * count))]
    assert parameter.range is not None
    low, high = parameter.range
    if parameter.scale == "log":
        value = math.exp(math.log(low) + share * (math.log(high) - math.log(low)))
    else:
        value = low + share * (high - low)
    return min(max(float(f"{value:.6g}"), low), high)


def share_of(parameter: CalibrationParameter, value: Plain) -> float:
    """The inverse of :func:`at_share` for a value of a range."""
    assert parameter.range is not None
    assert not isinstance(value, str)
    low, high = parameter.range
    if parameter.scale == "log":
        return math.log(value / low) / math.log(high / low)
    return (value - low) / (high - low)
