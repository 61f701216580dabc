"""`campaign.yaml`: what a campaign is about, apart from its trials."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, Strict, ValidationError

from vsr2.campaign.campaign import (
    MAX_MASS,
    MAX_NOTE,
    Campaign,
    MeasurementNoise,
    Specimen,
)
from vsr2.campaign.faults import id_fault, text_fault
from vsr2.campaign.file_problems import Problems
from vsr2.campaign.series import MAX_NOISE, MAX_TIME
from vsr2.config.problems import Problem, dotted, problems_of, shown
from vsr2.config.schema import DIALECT
from vsr2.config.section import Section
from vsr2.config.yaml_file import dump_yaml, nearest_above, read_yaml
from vsr2.errors import CampaignError, ConfigError

SCHEMA = "vsr2.campaign/1"
FILE = "campaign.yaml"
MODEL_SUFFIXES = (".obj", ".stl", ".ply")


def _text(limit: int, *, empty: bool) -> AfterValidator:
    def check(value: str) -> str:
        fault = text_fault(value, limit=limit, empty=empty)
        if fault is not None:
            raise ValueError(fault)
        return value

    return AfterValidator(check)


def _inside(value: str) -> str:
    path = PurePosixPath(value)
    if path.is_absolute() or ".." in path.parts or "\\" in value:
        raise ValueError(
            f"{shown(value)} leads out of the campaign's folder; copy the model into it"
        )
    if path.suffix.lower() not in MODEL_SUFFIXES:
        raise ValueError(f"{shown(value)} is none of {', '.join(MODEL_SUFFIXES)}; convert the mesh")
    return value


def _beside(value: str) -> str:
    if not re.fullmatch(r"\.\./[A-Za-z0-9][A-Za-z0-9._-]*", value):
        raise ValueError(
            f"{shown(value)} is no folder beside the campaign's, as `../motions`; name one, or "
            "leave the key out and put the files into motions/"
        )
    return value


# A block of several lines is how people write a description in YAML.
_Paragraph = Annotated[
    str, AfterValidator(lambda value: " ".join(value.split())), _text(10_000, empty=True)
]
_Error = Annotated[float, Strict(), Field(ge=0, le=MAX_NOISE)] | None
_Interval = Annotated[float, Strict(), Field(gt=0, le=MAX_TIME)] | None


class _Specimen(Section):
    description: Annotated[str, _text(MAX_NOTE, empty=True)] = ""
    mass_kg: Annotated[float, Strict(), Field(gt=0, le=MAX_MASS)] | None = None
    model_file: Annotated[str, _text(200, empty=False), AfterValidator(_inside)] | None = None


class _Noise(Section):
    """The channels of :class:`MeasurementNoise` in its order, with their units."""

    displacement_m: _Error = None
    acceleration_m_s2: _Error = None
    peak_tilt_rad: _Error = None
    peak_tilt_relative: _Error = None
    tilt_rad: _Error = None
    position_m: _Error = None
    orientation_rad: _Error = None
    yaw_rad: _Error = None
    slip_m: _Error = None


class _Sampling(Section):
    motion_interval_s: _Interval = None
    series_interval_s: _Interval = None


class _Content(Section):
    """The file's keys, but for `schema`."""

    name: Annotated[str, _text(200, empty=False)]
    """The campaign's name."""
    description: _Paragraph = ""
    units: Literal["SI"] = "SI"
    specimens: Annotated[dict[str, _Specimen | None], Field(min_length=1)]
    """Each specimen by its id, such as `SP1: {}`."""
    noise: _Noise | None = None
    sampling: _Sampling | None = None
    motions: Annotated[str, AfterValidator(_beside)] | None = None
    """Folder of the motion files, where several campaigns share one: `../motions`."""
    provenance: dict[str, Any] | None = None


def campaign_schema() -> dict[str, Any]:
    """The JSON schema of `campaign.yaml`, for editors that check and complete YAML."""
    content = _Content.model_json_schema()
    return {
        "$schema": DIALECT,
        **content,
        "title": "VSR2 campaign",
        "description": "What a campaign's files hold, beside its tables.",
        "properties": {"schema": {"const": SCHEMA}, **content["properties"]},
        "required": ["schema", *content["required"]],
    }


_NOISE_KEYS = dict(
    zip(_Noise.model_fields, (channel.name for channel in fields(MeasurementNoise)), strict=True)
)


@dataclass(frozen=True)
class Description:
    """The content of `campaign.yaml`.

    Attributes:
        name, description, specimens, noise, provenance: as in a campaign.
        sampling: stated intervals, by key [s].
        motions: folder of the motion files; "": the campaign's own.
    """

    name: str
    description: str = ""
    specimens: Mapping[str, Specimen] = field(default_factory=dict)
    noise: MeasurementNoise = field(default_factory=MeasurementNoise)
    sampling: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    motions: str = ""


def read_description(folder: Path, problems: Problems) -> tuple[Description | None, str | None]:
    """Read `campaign.yaml`.

    Returns:
        The description, None where `problems` got one; and the folder of its motion files, "" for
        the campaign's own, None where that is not known.
    """
    try:
        document = read_yaml(folder / FILE)
    except ConfigError as error:
        problems.add(FILE, error.message, row=error.line)
        return None, None
    found: list[Problem] = []
    description = _description(dict(document.data), folder, found)
    for problem in found:
        line = nearest_above(document.lines, problem.path)
        problems.add(FILE, problem.what, row=line, column=dotted(problem.path)[:100])
    return None if found else description, _motions(document.data.get("motions"), found)


def _motions(stated: object, problems: Sequence[Problem]) -> str | None:
    """Folder of motion files, "" for the campaign's own; None where wrong keys hide it."""
    wrong = {problem.path[0] for problem in problems}
    if isinstance(stated, str):
        return None if wrong & {"schema", "motions"} else stated
    # A key that is not known may be a misspelt `motions`.
    return "" if wrong <= _Content.model_fields.keys() - {"motions"} else None


def _description(data: dict[str, Any], folder: Path, problems: list[Problem]) -> Description | None:
    schema = data.pop("schema", None)
    if schema != SCHEMA:
        problems.append(Problem(("schema",), f"is {shown(schema)}; this reader knows {SCHEMA!r}"))
        return None
    try:
        content = _Content.model_validate(data)
    except ValidationError as error:
        problems.extend(problems_of(error, _Content))
        return None
    specimens = {}
    for key, given in content.specimens.items():
        stated = given or _Specimen()
        model = None if stated.model_file is None else folder / stated.model_file
        fault = id_fault(key)
        if fault is not None:
            problems.append(Problem(("specimens", key), fault))
        if model is not None and not _is_file(model):
            problems.append(
                Problem(
                    ("specimens", key, "model_file"),
                    f"no such file ({shown(stated.model_file)}); add it, or remove the key",
                )
            )
        specimens[key] = Specimen(stated.description, stated.mass_kg, model)
    noise = (content.noise or _Noise()).model_dump()
    sampling = content.sampling or _Sampling()
    return Description(
        name=content.name,
        description=content.description,
        specimens=specimens,
        noise=MeasurementNoise(**{_NOISE_KEYS[key]: value for key, value in noise.items()}),
        sampling=sampling.model_dump(exclude_none=True),
        provenance=content.provenance or {},
        motions=content.motions or "",
    )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def dump_description(
    campaign: Campaign, sampling: Mapping[str, float], models: Mapping[str, str], motions: str
) -> str:
    """The text of `campaign.yaml`.

    Args:
        campaign: what to write.
        sampling: intervals to state, by key [s].
        models: of each specimen that has a model, its path within the campaign's folder.
        motions: folder of the motion files; "": the campaign's own.

    Raises:
        CampaignError: the provenance is not JSON-serialisable.
    """
    specimens: dict[str, Any] = {}
    for key, specimen in campaign.specimens.items():
        entry = {
            "description": specimen.description or None,
            "mass_kg": specimen.mass,
            "model_file": models.get(key),
        }
        specimens[key] = {name: value for name, value in entry.items() if value is not None}
    noise = {key: getattr(campaign.noise, name) for key, name in _NOISE_KEYS.items()}
    try:
        provenance = json.loads(json.dumps(campaign.provenance))
    except (TypeError, ValueError) as error:
        raise CampaignError(
            f"campaign {campaign.name!r}: its provenance cannot be written ({error}); give "
            "plain data"
        ) from None
    content = {
        "schema": SCHEMA,
        "name": campaign.name,
        "description": campaign.description,
        "units": "SI",
        "specimens": specimens,
        "sampling": dict(sampling),
        "motions": motions,
        "noise": {key: value for key, value in noise.items() if value is not None},
        "provenance": provenance,
    }
    return dump_yaml({key: value for key, value in content.items() if value not in ("", {})})
