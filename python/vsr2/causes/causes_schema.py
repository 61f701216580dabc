"""The form of `causes.json`, from which its JSON Schema is generated."""

from __future__ import annotations

from typing import Any, Literal, get_args

from pydantic import ConfigDict, Field

from vsr2.causes.margins.cause_space import NotJudged
from vsr2.diagnosis.verdict.diagnosis_schema import (
    Control,
    Controls,
    Count,
    Estimate,
    SchemaPart,
    Share,
)
from vsr2.errors import Fault

CausesSchema = Literal["vsr2.causes/5"]
CAUSES_SCHEMA: CausesSchema = get_args(CausesSchema)[0]
"""Form of causes.json."""
Ends = tuple[float | None, float | None]


class _Size(SchemaPart):
    """With its 90 % interval; null: infinite."""

    mean: float | None
    interval: Ends


class _Parameter(_Size):
    unit: str


class _Cause(SchemaPart):
    """Parameters are given that the effect acts; none: it acts in no sample."""

    name: str
    acts: Share
    parameters: dict[str, _Parameter]


class _Together(SchemaPart):
    names: list[str]
    probability: Share


class _Scatter(SchemaPart):
    motion: _Size
    trial: _Size


class _Emulator(SchemaPart):
    """`used` of the scenes; errors are null where margins are equal in all of them."""

    scenes: int
    used: int
    spread: float | None
    error: float | None
    error_over_expected: float | None
    noise: float


class _Loss(SchemaPart):
    loss: Estimate


class _Floor(_Loss):
    """Scores of simulations by the others, with where 95 % of these lie."""

    scores: dict[str, Estimate]


class _Likely(Control):
    """With the effects that are likely by the other folds; in how many of the folds each is."""

    folds: dict[str, Count]
    of: Count
    scores: dict[str, Estimate]


class _Step(Control):
    causes: list[str]


class _CauseShare(SchemaPart):
    loss: Estimate
    of_gap: Estimate
    first: Estimate
    last: Estimate


class _Logistic(Control):
    scores: dict[str, Estimate]
    loss_above_all: Estimate


class _HeldOut(SchemaPart):
    """Losses a trial [nat] on motions that were not seen.

    `scatter_alone`: no effect acts. `beyond_...`: share of the gap that all effects close beyond
    it, beyond the better control, beyond the curve without physics.
    """

    as_it_is: _Loss
    waterfall: list[_Step]
    all: Control
    likely: _Likely
    floor: _Floor
    scatter_alone: Control
    beyond_scatter: Estimate
    controls: Controls
    beyond_controls: Estimate
    beyond_logistic: Estimate | None
    shares: dict[str, _CauseShare]
    scores: dict[str, Estimate]
    logistic: _Logistic | None


class _Provenance(SchemaPart):
    """Versions, settings, constants, and what the run cost.

    `simulated`: of the simulations that were asked for, those that this run made; others were kept.
    `search_time_s` of `wall_time_s` went to choosing and simulating scenes.
    """

    model_config = ConfigDict(extra="allow")

    build: dict[str, str]
    threads: Count
    wall_time_s: float
    search_time_s: float
    simulations: Count
    simulated: Count


class _Causes(SchemaPart):
    """The causes of a campaign's outcomes, several at once."""

    form: CausesSchema = Field(alias="schema")
    campaign: str
    trials: int
    motions: int
    causes: list[_Cause]
    together: list[_Together]
    log_evidence: float
    motion_stronger_by: _Size
    scatter: _Scatter
    emulator: _Emulator
    held_out: _HeldOut
    corrected: dict[str, dict[str, float]]
    not_stated: list[str]
    not_judged: dict[str, NotJudged]
    excluded: list[str]
    unavailable: dict[str, Fault]
    provenance: _Provenance


def causes_schema() -> dict[str, Any]:
    """The JSON Schema of `causes.json`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": CAUSES_SCHEMA,
        **_Causes.model_json_schema(),
    }
