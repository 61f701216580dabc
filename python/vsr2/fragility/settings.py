"""The fragility study: a study, and how its trials are varied and summed up."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import Field, Strict, model_validator

from vsr2.analysis.intervals import INTERVALS
from vsr2.config.extended import ExtendedStudy, load_extended
from vsr2.config.motion_source import AllRecordings, SingleRecording
from vsr2.config.schema import extended_schema
from vsr2.config.section import Real, Section
from vsr2.config.sources import EXACT_START, SMOOTH_CURVE, USUAL_LEVEL
from vsr2.effects import check_study_effects, effect
from vsr2.errors import ConfigError

Measure = Literal[
    "pga_g", "pgv_m_s", "pgd_m", "pgv_pga_s", "arias_m_s", "cav_m_s", "duration_5_95_s"
]

MEASURES: dict[str, tuple[str, str]] = {
    "pga_g": ("PGA", "g"),
    "pgv_m_s": ("PGV", "m/s"),
    "pgd_m": ("PGD", "m"),
    "pgv_pga_s": ("PGV/PGA", "s"),
    "arias_m_s": ("Arias intensity", "m/s"),
    "cav_m_s": ("CAV", "m/s"),
    "duration_5_95_s": ("significant duration 5-95 %", "s"),
}
"""Name and unit of the intensity measures."""
MEASURE_LABELS = {key: f"{name} [{unit}]" for key, (name, unit) in MEASURES.items()}
"""Intensity measures as they stand on an axis."""

MAX_PGA_G = 100.0
"""Greatest PGA that recordings are scaled to [g]; more is a mistaken unit."""


@dataclass(frozen=True)
class FitConstants:
    """What a fit is judged by; chosen by hand, the prior after Greenland and Mansournia (2015).

    Attributes:
        prior_location: where the prior's two half trials lie on their coefficient's axis.
        fall: a surface that falls by more than this as intensity rises gets a note.
        significant: curvature beyond this quantile of no curvature says that a lognormal curve does
            not fit.
        fewest_levels: different intensities that tell a curvature: one more than the coefficients.
        fall_grid: intensity levels along each axis on which a fall is looked for.
        on_hull: distance from the hull of the trials that counts as on it, in spreads of them.
        half_walkers: of the ensemble sampler, of each half, over the number of coefficients.
        first_spread: of the walkers at first, over the posterior's own deviation.
        burn_in: first steps of the walkers, which are not kept.
        steps: after them.
        thin: one step in so many is kept.
        iterations: most of the least squares that find the mode.
        converged: change of the deviance at which they end [1].
    """

    prior_location: float = 0.1
    fall: float = 0.05
    significant: float = 0.95
    fewest_levels: int = 5
    fall_grid: int = 25
    on_hull: float = 1e-6
    half_walkers: int = 8
    first_spread: float = 0.3
    burn_in: int = 150
    steps: int = 500
    thin: int = 4
    iterations: int = 500
    converged: float = 1e-10


FIT = FitConstants()


class Jitter(Section):
    """Standard deviations of the normal perturbations of each trial's start; 0: none."""

    yaw: Annotated[float, Strict(), Field(ge=0, le=180), EXACT_START] = 0.0
    """Of the turn about the vertical [degree]."""
    offset: Annotated[float, Strict(), Field(ge=0, le=10), EXACT_START] = 0.0
    """Of the place on the pedestal, along x and along y [m]."""
    tilt: Annotated[float, Strict(), Field(ge=0, le=10), EXACT_START] = 0.0
    """Of the tilt about x and about y before the rock settles [degree]."""

    @property
    def any(self) -> bool:
        """Whether anything is perturbed."""
        return self.yaw > 0 or self.offset > 0 or self.tilt > 0


class FragilitySettings(Section):
    """The section `fragility`."""

    measures: Annotated[tuple[Measure, ...], Field(min_length=1, max_length=2)] = ("pga_g",)
    """Intensity measures, of the motions as driven, before effects; two of them: a surface, too."""
    target_pga_g: Annotated[tuple[Real, ...], Field(min_length=1, max_length=1000)] | None = None
    """Scale every recording to each of these PGAs [g]; none given: as they are."""
    azimuths: Annotated[tuple[Real, ...], Field(min_length=1, max_length=360)] | None = None
    """Turns of the rock about the vertical at the start, instead of `rock.start.yaw` [degree]."""
    replicates: Annotated[int, Strict(), Field(ge=1, le=10_000), EXACT_START] = 1
    """Trials of each motion at each azimuth, perturbed independently of each other."""
    jitter: Jitter = Jitter()
    """How the start is perturbed."""
    surface: Literal["quadratic", "linear"] = "quadratic"
    """Terms of the surface in the logarithms of two measures."""
    level: Annotated[float, Strict(), Field(gt=0, lt=1), USUAL_LEVEL] = INTERVALS.level
    """Of the confidence bands."""
    points: Annotated[int, Strict(), Field(ge=2, le=500), SMOOTH_CURVE] = 41
    """Intensity levels of a curve; a surface has as many along each axis."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.replicates > 1 and not self.jitter.any:
            raise ValueError(
                "replicates: without `jitter` all replicates are one and the same trial; give it, "
                "or leave `replicates` at 1"
            )
        if self.surface == "linear" and len(self.measures) == 1:
            raise ValueError("surface: has no effect with one measure; name two, or remove it")
        if len(set(self.measures)) != len(self.measures):
            raise ValueError("measures: one is there twice")
        for value in self.target_pga_g or ():
            if not 0 < value <= MAX_PGA_G:
                raise ValueError(
                    f"target_pga_g: {value:g} is not above 0 and at most {MAX_PGA_G:g} g; check "
                    "the unit"
                )
        for key in ("target_pga_g", "azimuths"):
            values = getattr(self, key)
            if values is not None and len(set(values)) != len(values):
                raise ValueError(f"{key}: one is there twice")
        return self


class FragilityKeys(Section):
    """The keys of a fragility study beside a study's own."""

    fragility: FragilitySettings = FragilitySettings()
    """How trials are varied and summed up."""


FragilityStudy = ExtendedStudy[FragilityKeys]


def fragility_schema() -> dict[str, Any]:
    """The JSON schema of a fragility study, for editors that check and complete YAML."""
    return extended_schema(FragilityKeys, "VSR2 fragility study")


def load_fragility(
    path: str | os.PathLike[str], *, overrides: Sequence[str] = ()
) -> FragilityStudy:
    """Read a fragility study.

    Args:
        path: YAML file; paths in it are relative to its folder.
        overrides: as in :func:`vsr2.config.load_study`.

    Raises:
        ConfigError: what is wrong, by file, line and key.
    """
    study = load_extended(path, FragilityKeys, overrides=overrides)
    check_study_effects(study.study.effects, study.label)
    for name in study.study.effects:
        if effect(name).stage == "order":
            raise ConfigError(
                f"{study.label}: effects.{name}: acts by the order of a campaign's trials, and "
                "fragility has none; state what acts throughout, or leave it out"
            )
    own = study.own.fragility
    if own.target_pga_g is not None and not isinstance(
        study.study.motion, (SingleRecording, AllRecordings)
    ):
        raise ConfigError(
            f"{study.label}: fragility.target_pga_g: scales recordings; set "
            "motion.pga_g for cosines"
        )
    if (own.azimuths is not None or own.jitter.any) and study.study.rock.start.mode != "yaw":
        raise ConfigError(
            f"{study.label}: rock.start: azimuths and jitter turn and lower the rock again; use "
            "`mode: yaw` with `base_orientation`, `yaw` and `position_xy`"
        )
    return study
