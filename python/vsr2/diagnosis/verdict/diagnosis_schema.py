"""The form of `diagnosis.json`, from which its JSON Schema is generated."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema

from vsr2.campaign import Tier
from vsr2.codes import NAMES, Code
from vsr2.diagnosis.verdict.document import SCHEMA, Schema
from vsr2.diagnosis.verdict.next_measurement import Instrument, MeasurementKind
from vsr2.diagnosis.verdict.statements import (
    BudgetState,
    GapState,
    LimitCode,
    ReasonCode,
    VerdictKind,
)
from vsr2.diagnosis.where.scan import LocationAxis, LocationKind
from vsr2.ensemble.observed.features import FeatureChannel, Phase
from vsr2.errors import Fault

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
Ends = tuple[float | None, float | None]
_VALUES: dict[type, dict[str, Any]] = {
    float: {"type": ["number", "null"]},
    int: {"type": "integer"},
    str: {"type": "string"},
    Fault: {"enum": [str(fault) for fault in Fault]},
    NAMES: {"type": "array", "items": {"type": "string"}},
}


def _statements(codes: type[Code]) -> dict[str, Any]:
    """Of a list of statements: each code with its values, and a sentence where one was added."""
    one_of = []
    for code in codes:
        values = {name: _VALUES[kind] for name, kind in code.types.items()}
        properties = {
            "code": {"const": str(code)},
            "values": _closed(values, list(values)),
            "text": {"type": "string"},
        }
        one_of.append(_closed(properties, ["code", "values"]))
    return {"type": "array", "items": {"oneOf": one_of}}


def _closed(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


class SchemaPart(BaseModel):
    """Of a document: no key but those that are stated."""

    model_config = ConfigDict(extra="forbid")


class _Campaign(SchemaPart):
    name: str
    trials: Count
    tier: Tier
    motions: Count
    sessions: Count
    responding_trials: Count


class Estimate(SchemaPart):
    """With its 95 % interval; null: there is none."""

    value: float | None
    ci95: Ends | None


class _Layers(SchemaPart):
    """Shares of outcomes that change although nothing of substance does."""

    numerical: Share | None
    time_step: Share | None
    solver: Share | None
    input: Share | None
    nuisance: Share | None
    physical: Share | None
    physical_expected: Share | None
    trials: Count
    repeats: Count


class _Gap(SchemaPart):
    """Losses a trial [nat], and what they say together.

    `fit`: tail probability of the campaign among simulated ones without effect. `discrepancy`:
    standard deviation of the logarithm of a largest tilt between correct simulators [1].
    """

    state: GapState
    fit: Share
    effects: list[str]
    before: Estimate
    after: Estimate
    floor: Estimate
    excess: Estimate
    excess_after: Estimate
    gain: Estimate
    closure: Estimate
    headline: Estimate
    discrepancy: Estimate
    layers: _Layers


class _Place(SchemaPart):
    kind: LocationKind
    values: dict[str, str]


class _Located(SchemaPart):
    """Which location it is; of an intensity the values are thirds of the campaign's."""

    location: _Place
    axis: LocationAxis
    feature: str
    channel: FeatureChannel
    phase: Phase
    text: str = ""


class _Location(_Located):
    """A location that was scanned; `trials` of those that stand out alone."""

    effect_size: float
    p_familywise: Share
    concentration: float
    concentration_ci90: tuple[float, float]
    trials: list[str] | None


class _Verdict(SchemaPart):
    kind: VerdictKind
    effects: list[str]
    findings: list[list[str]]
    probability: Share
    reasons: Annotated[list[Any], WithJsonSchema(_statements(ReasonCode))]
    text: str = ""


class _Parameter(SchemaPart):
    """Given that the effect acts; null: infinite."""

    mean: float | None
    median: float | None
    ci90: Ends
    ci95: Ends
    unit: str


class _Effect(SchemaPart):
    """`probability` sums to 1 with none and unknown; `acts` counts every set that holds it."""

    name: str
    probability: Share
    acts: Share
    parameters: dict[str, _Parameter]


class _Set(SchemaPart):
    effects: list[str]
    probability: Share


class _Unknown(SchemaPart):
    probability: Share
    detection_rate: Share


class Control(SchemaPart):
    """Loss a trial [nat], and the share of the gap that it closes."""

    closure: Estimate
    loss: Estimate


class Controls(SchemaPart):
    """Negative controls."""

    recalibrated: Control
    dealt: Control


class _Cause(SchemaPart):
    """What one effect takes off the loss: over all orders, first of all, last of all."""

    name: str
    share: Estimate
    first: Estimate
    last: Estimate


class _Step(SchemaPart):
    effects: list[str]
    loss: Estimate


class _Waterfall(SchemaPart):
    """Losses a trial [nat] on motions that neither fit nor choice saw."""

    effects: list[_Cause]
    steps: list[_Step]
    everything: Estimate
    floor: Estimate
    closure: Estimate


class _Posterior(SchemaPart):
    """What calibration on held-out campaigns set."""

    temperature: float
    none_limit: Share
    least_name: Share
    least_together: Share
    none_set_level: Share
    gap_set_level: Share
    known_held: Share
    wrong: Share
    named: Share
    detection_rate: Share
    campaigns: Count


class _Repetition(SchemaPart):
    trial: str
    information_per_repeat: float
    repeats: Count | None


class _Rival(SchemaPart):
    name: str
    instrument: Instrument
    repetition: _Repetition


class _OutOfLibrary(SchemaPart):
    trial: str
    tier: Tier
    location: _Located | None


class _Measurement(SchemaPart):
    kind: MeasurementKind
    splits: list[str]
    instruments: list[Instrument]
    repetition: _Repetition | None
    others: list[_Rival]
    out_of_library: _OutOfLibrary | None
    text: str = ""


class _Corrected(SchemaPart):
    """What is added to the scene, and all effects of the corrected one; null: no study states them.

    `among` are the effects that the verdict names.
    """

    effects: dict[str, dict[str, float | str]]
    among: list[str]
    scene: dict[str, dict[str, float | str]] | None


class _Budget(SchemaPart):
    state: BudgetState
    simulations: Count
    allowed: Count
    cost_s: float
    simulated: Count
    reused: Count
    campaigns: Count
    trials: Count


class _Reference(SchemaPart):
    campaign: str
    none: Share


class _Provenance(SchemaPart):
    """Versions, budget, constants and whatever else a simulator notes."""

    model_config = ConfigDict(extra="allow")

    versions: dict[str, str]
    budget: _Budget
    detection_limits: dict[str, float]
    constants: dict[str, dict[str, Any]]
    excluded: list[str]
    references: list[_Reference]
    held_out: bool
    nuisances: list[str]
    simulator: str
    seed: Count
    wall_time_s: float


class _Diagnosis(SchemaPart):
    """Diagnosis of the sim-to-real gap."""

    form: Schema = Field(alias="schema")
    campaign: _Campaign
    gap: _Gap
    where: list[_Location]
    verdict: _Verdict
    effects: list[_Effect]
    sets: list[_Set]
    none_probability: Share
    unknown: _Unknown
    conformal_set_90: list[str]
    waterfall: _Waterfall | None
    negative_control: Controls
    posterior: _Posterior
    next_measurement: _Measurement | None
    limits: Annotated[list[Any], WithJsonSchema(_statements(LimitCode))]
    corrected: _Corrected | None
    provenance: _Provenance


def schema() -> dict[str, Any]:
    """The JSON Schema of `diagnosis.json`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA,
        **_Diagnosis.model_json_schema(),
    }
