"""`campaign.yaml`: what a campaign is about, apart from its trials."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path, PurePosixPath
from typing import Any

from vsr2.campaign.campaign import (
    MAX_MASS,
    MAX_NOTE,
    MeasurementNoise,
    Specimen,
    id_fault,
    number_fault,
    text_fault,
)
from vsr2.campaign.problems import Problems
from vsr2.config.problems import shown
from vsr2.config.yaml_file import YamlDocument, dump_yaml, read_yaml
from vsr2.errors import CampaignError, ConfigError

SCHEMA = "vsr2.campaign/1"
FILE = "campaign.yaml"
MODEL_SUFFIXES = (".obj", ".stl", ".ply")

_KEYS = (
    "schema",
    "name",
    "description",
    "units",
    "specimens",
    "sampling",
    "noise",
    "provenance",
)
_NOISE_KEYS = {
    "displacement_m": "displacement",
    "acceleration_m_s2": "acceleration",
    "peak_tilt_rad": "peak_tilt",
    "tilt_rad": "tilt",
    "position_m": "position",
    "orientation_rad": "orientation",
}
_SAMPLING_KEYS = ("motion_interval_s", "series_interval_s")
_SPECIMEN_KEYS = ("description", "mass_kg", "model_file")


@dataclass(frozen=True)
class Description:
    """The content of `campaign.yaml`.

    Attributes:
        name, description, specimens, noise, provenance: as in a campaign.
        sampling: stated intervals, by key [s].
    """

    name: str
    description: str = ""
    specimens: Mapping[str, Specimen] = field(default_factory=dict)
    noise: MeasurementNoise = field(default_factory=MeasurementNoise)
    sampling: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)


def read_description(folder: Path, problems: Problems) -> Description | None:
    """Read `campaign.yaml`; None where `problems` got one."""
    path = folder / FILE
    try:
        document = read_yaml(path)
    except ConfigError as error:
        # The reader names file and line in front; the file is already said.
        problems.add(FILE, str(error).removeprefix(str(path)).lstrip(": "))
        return None
    before = len(problems.found)
    reader = _Reader(document, folder, problems)
    description = reader.read()
    return description if len(problems.found) == before else None


class _Reader:
    """Walks the mapping and notes what is wrong, by line and key."""

    def __init__(self, document: YamlDocument, folder: Path, problems: Problems) -> None:
        self._data = document.data
        self._lines = document.lines
        self._folder = folder
        self._problems = problems

    def read(self) -> Description | None:
        self._known((), self._data, _KEYS)
        schema = self._data.get("schema")
        if schema != SCHEMA:
            self._add(("schema",), f"is {shown(schema)}; this reader knows {SCHEMA!r}")
            return None
        if self._data.get("units", "SI") != "SI":
            self._add(("units",), f"is {shown(self._data['units'])}; convert all to SI")
        name = self._text("name", required=True)
        description = self._text("description", limit=10_000)
        specimens = self._specimens()
        noise = self._numbers("noise", tuple(_NOISE_KEYS), above=False)
        sampling = self._numbers("sampling", _SAMPLING_KEYS, above=True)
        provenance = self._section("provenance")
        if self._problems:
            return None
        return Description(
            name=name,
            description=description,
            specimens=specimens,
            noise=MeasurementNoise(**{_NOISE_KEYS[key]: value for key, value in noise.items()}),
            sampling=sampling,
            provenance=provenance,
        )

    def _add(self, path: tuple[str, ...], what: str) -> None:
        line = next(
            (self._lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in self._lines),
            None,
        )
        key = ".".join(part if part.isprintable() else shown(part) for part in path)
        self._problems.add(FILE, what, row=line, column=key[:100])

    def _known(
        self, above: tuple[str, ...], given: Mapping[str, Any], known: tuple[str, ...]
    ) -> None:
        for key in given:
            if key not in known:
                self._add((*above, key), f"is no key here; known are {', '.join(known)}")

    def _section(self, key: str) -> dict[str, Any]:
        value = self._data.get(key)
        if value is None:
            return {}
        if not isinstance(value, dict):
            self._add((key,), f"is {shown(value)}; give a mapping")
            return {}
        return value

    def _text(self, key: str, *, required: bool = False, limit: int = 200) -> str:
        value = self._data.get(key, "")
        if key == "description" and isinstance(value, str):
            # A block of several lines is how people write one in YAML.
            value = " ".join(value.split())
        fault = text_fault(value, limit=limit, empty=not required)
        if fault is not None:
            self._add((key,), fault)
            return ""
        assert isinstance(value, str)
        return value

    def _numbers(self, section: str, known: tuple[str, ...], *, above: bool) -> dict[str, float]:
        given = self._section(section)
        self._known((section,), given, known)
        out: dict[str, float] = {}
        for key in known:
            if given.get(key) is not None:
                fault = number_fault(given[key], 0, 1e5, "", above=above)
                if fault is None:
                    out[key] = float(given[key])
                else:
                    self._add((section, key), fault)
        return out

    def _specimens(self) -> dict[str, Specimen]:
        given = self._section("specimens")
        if not given:
            self._add(("specimens",), "names none; give each specimen's id, such as `SP1: {}`")
        return {key: self._specimen(key, value) for key, value in given.items()}

    def _specimen(self, key: str, value: object) -> Specimen:
        place = ("specimens", key)
        fault = id_fault(key)
        if fault is not None:
            self._add(place, fault)
        if value is None:
            return Specimen()
        if not isinstance(value, dict):
            self._add(place, f"is {shown(value)}; give a mapping, `{{}}` where nothing is known")
            return Specimen()
        self._known(place, value, _SPECIMEN_KEYS)
        mass, text = value.get("mass_kg"), value.get("description", "")
        faults = {"description": text_fault(text, limit=MAX_NOTE, empty=True)}
        if mass is not None:
            faults["mass_kg"] = number_fault(mass, 0, MAX_MASS, "kg", above=True)
        for name, fault in faults.items():
            if fault is not None:
                self._add((*place, name), fault)
        model = self._model((*place, "model_file"), value.get("model_file"))
        if any(faults.values()):
            return Specimen()
        return Specimen(text, None if mass is None else float(mass), model)

    def _model(self, place: tuple[str, ...], value: object) -> Path | None:
        if value is None:
            return None
        fault = text_fault(value)
        if fault is None:
            path = PurePosixPath(str(value))
            if path.is_absolute() or ".." in path.parts or "\\" in str(value):
                fault = f"{shown(value)} leads out of the campaign's folder; copy the model into it"
            elif path.suffix.lower() not in MODEL_SUFFIXES:
                fault = f"{shown(value)} is none of {', '.join(MODEL_SUFFIXES)}; convert the mesh"
            elif not _is_file(self._folder / path):
                fault = f"no such file ({shown(value)}); add it, or remove the key"
            else:
                return self._folder / path
        self._add(place, fault)
        return None


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def dump_description(description: Description, models: Mapping[str, str]) -> str:
    """The text of `campaign.yaml`.

    Args:
        description: what to write.
        models: of each specimen that has a model, its path within the campaign's folder.

    Raises:
        CampaignError: the provenance is not JSON-serialisable.
    """
    specimens: dict[str, Any] = {}
    for key, specimen in description.specimens.items():
        entry = {
            "description": specimen.description or None,
            "mass_kg": specimen.mass,
            "model_file": models.get(key),
        }
        specimens[key] = {name: value for name, value in entry.items() if value is not None}
    noise = {key: getattr(description.noise, name) for key, name in _NOISE_KEYS.items()}
    assert set(_NOISE_KEYS.values()) == {channel.name for channel in fields(MeasurementNoise)}
    try:
        provenance = json.loads(json.dumps(description.provenance))
    except (TypeError, ValueError) as error:
        raise CampaignError(
            f"campaign {description.name!r}: its provenance cannot be written ({error}); give "
            "plain data"
        ) from None
    content = {
        "schema": SCHEMA,
        "name": description.name,
        "description": description.description,
        "units": "SI",
        "specimens": specimens,
        "sampling": dict(description.sampling),
        "noise": {key: value for key, value in noise.items() if value is not None},
        "provenance": provenance,
    }
    kept = {key: value for key, value in content.items() if value not in ("", {})}
    return dump_yaml(kept)
