"""The form of `diagnosis.json`, from which its JSON Schema is generated."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema

from vsr2.campaign import Tier
from vsr2.codes import NAMES, Code
from vsr2.diagnosis.observed.features import FeatureChannel, Phase
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


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Campaign(_Part):
    name: str
    trials: Count
    tier: Tier
    motions: Count
    sessions: Count
    responding_trials: Count


class _Estimate(_Part):
    """With its 95 % interval; null: there is none."""

    value: float | None
    ci95: Ends | None


class _Layers(_Part):
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


class _Gap(_Part):
    """Losses a trial [nat], and what they say together.

    `fit`: tail probability of the campaign among simulated ones without effect. `library_fit`: that
    of what the library leaves unexplained, among simulated campaigns of like misfit.
    """

    state: GapState
    fit: Share
    library_fit: Share
    effects: list[str]
    before: _Estimate
    after: _Estimate
    floor: _Estimate
    excess: _Estimate
    excess_after: _Estimate
    gain: _Estimate
    closure: _Estimate
    headline: _Estimate
    layers: _Layers


class _Place(_Part):
    kind: LocationKind
    values: dict[str, str]


class _Located(_Part):
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
    trials: list[str] | None


class _Verdict(_Part):
    kind: VerdictKind
    effects: list[str]
    findings: list[list[str]]
    probability: Share
    reasons: Annotated[list[Any], WithJsonSchema(_statements(ReasonCode))]
    text: str = ""


class _Parameter(_Part):
    """Given that the effect acts; null: infinite."""

    mean: float | None
    median: float | None
    ci90: Ends
    ci95: Ends
    unit: str


class _Effect(_Part):
    """`probability` sums to 1 with none and unknown; `acts` counts every set that holds it."""

    name: str
    probability: Share
    acts: Share
    parameters: dict[str, _Parameter]


class _Set(_Part):
    effects: list[str]
    probability: Share


class _Unknown(_Part):
    probability: Share
    detection_rate: Share


class _Control(_Part):
    closure: _Estimate
    loss: _Estimate


class _Controls(_Part):
    recalibrated: _Control
    dealt: _Control


class _Cause(_Part):
    """What one effect takes off the loss: over all orders, first of all, last of all."""

    name: str
    share: _Estimate
    first: _Estimate
    last: _Estimate


class _Step(_Part):
    effects: list[str]
    loss: _Estimate


class _Waterfall(_Part):
    """Losses a trial [nat] on motions that neither fit nor choice saw."""

    effects: list[_Cause]
    steps: list[_Step]
    everything: _Estimate
    floor: _Estimate
    closure: _Estimate


class _Posterior(_Part):
    """What calibration on held-out campaigns set."""

    temperature: float
    none_limit: Share
    least_name: Share
    least_together: Share
    set_level: Share
    wrong: Share
    named: Share
    detection_rate: Share
    campaigns: Count


class _Repetition(_Part):
    trial: str
    information_per_repeat: float
    repeats: Count | None


class _Rival(_Part):
    name: str
    instrument: Instrument
    repetition: _Repetition


class _OutOfLibrary(_Part):
    trial: str
    tier: Tier
    location: _Located | None


class _Measurement(_Part):
    kind: MeasurementKind
    splits: list[str]
    instruments: list[Instrument]
    repetition: _Repetition | None
    others: list[_Rival]
    out_of_library: _OutOfLibrary | None
    text: str = ""


class _Corrected(_Part):
    """What is added to the scene, and all effects of the corrected one; null: no study states them.

    `among` are the effects that the verdict names.
    """

    effects: dict[str, dict[str, float | str]]
    among: list[str]
    scene: dict[str, dict[str, float | str]] | None


class _Budget(_Part):
    state: BudgetState
    simulations: Count
    allowed: Count
    cost_s: float
    simulated: Count
    reused: Count
    campaigns: Count


class _Reference(_Part):
    campaign: str
    none: Share


class _Provenance(_Part):
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


class _Diagnosis(_Part):
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
    negative_control: _Controls
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
