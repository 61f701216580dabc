"""A quick engine, hand-made packs and verdicts for tests of the blind check."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vsr2.ensemble.observed.observations as observations
from foreign_pack import change_pack, write_pack
from vsr2.blind import diagnose_pack, make_pack
from vsr2.blind.custodian.design import catalogue, draw_protocol
from vsr2.blind.form.pack_settings import PackSettings
from vsr2.blind.form.seal import KEY_SCHEMA, PACK_SCHEMA, commitment, folder_sha256, write_json
from vsr2.blind.mujoco import Drawable, GroundMotion, Parameter, Response
from vsr2.diagnosis.verdict.document import SCHEMA
from vsr2.effects import library
from vsr2.errors import BlindError

SCENE = Path(__file__).resolve().parents[2] / "configs" / "blind.yaml"
SMALL = {"trials": 12, "motions": 4, "sessions": 3, "catalogue": 5}
SMALL |= {"signal_trials": 8, "replicates": 6}


def strength_of(name):
    """Parameter of an effect as the library names it; of one that it lacks `change`."""
    known = library().get(name)
    return known.parameters[0].name if known else "change"


def null_of(name):
    """Value of an effect's strength without effect; an impact's energy relative to Housner's."""
    known = library().get(name)
    null = known.parameters[0].null if known else 0.0
    return 1.0 if np.isnan(null) else null


def moved(name, values):
    """How far an effect's strength is from its null."""
    return values[strength_of(name)] - null_of(name)


class QuickEngine:
    """Answers at once: tilt grows with the motion's peak acceleration, as effects scale it."""

    name = "mujoco"
    versions = {"quick": "1"}  # noqa: RUF012
    static_acceleration = 4.0
    effects = {  # noqa: RUF012
        name: Drawable(
            name,
            Parameter(
                strength_of(name),
                "1",
                null_of(name),
                null_of(name) - 0.3 * signed,
                null_of(name) + 0.3,
            ),
            (),
            drifts,
        )
        for name, signed, drifts in (
            ("table_gain", True, False),
            ("slenderness", True, False),
            ("wear", False, True),
            ("restitution", True, False),
            ("friction", True, False),
            ("inertia", True, False),
        )
    }

    def __init__(self, study=None):
        self.shaken = 0

    def run(self, shakes, series_interval):
        for shake in shakes:
            self.shaken += 1
            peak = np.abs(np.diff(shake.displacement, 2)).max() / shake.interval**2
            n = shake.nuisances
            level = peak / 6.0 * n.height / n.width * (1 + 0.1 * shake.yaw)
            for i, (name, values) in enumerate(sorted(shake.effects.items())):
                part = shake.context.order if name == "wear" else 1.0
                level *= 1 + part * moved(name, values) * (1 + 0.1 * i)
            tilt = min(1.25, 0.05 * level**3)
            time = np.arange(0.0, 1.0, series_interval)
            yield Response(
                bool(level > 1.6),
                float(tilt),
                time,
                tilt * np.sin(np.pi * time),
                np.zeros((time.size, 3)),
                np.tile([0.0, 0.0, 0.0, 1.0], (time.size, 1)),
            )


def diagnosis(kind, probabilities, effects=(), conformal=(), **more):
    """Content of a `diagnosis.json`."""
    entries = [{"name": n, "probability": p, "parameters": {}} for n, p in probabilities.items()]
    for entry in entries:
        entry |= more.get(entry["name"], {})
    return {
        "schema": SCHEMA,
        "gap": {
            "closure": {"value": more.get("closure"), "ci95": [0.0, 1.0]},
            "headline": {"value": more.get("headline"), "ci95": [0.0, 1.0]},
            "gain": {"value": 0.0, "ci95": more.get("gain")},
        },
        "where": more.get("where", []),
        "verdict": {"kind": kind, "effects": list(effects), "probability": 0.5},
        "effects": entries,
        "conformal_set_90": list(conformal),
    }


def effect(name, value=0.1, relative=3.0, null="the library's", strength=None):
    """An effect of a key; a null of None is infinity."""
    strength = strength or strength_of(name)
    null = null_of(name) if isinstance(null, str) else null
    return {
        "name": name,
        "values": {strength: value},
        "strength": strength,
        "unit": "1",
        "null": null,
        "relative": relative,
        "drifts": name == "wear",
    }


def classes_of(effects):
    """Names of the effects and of what nothing distinguishes from them."""
    settings = PackSettings()
    return sorted({name for e in effects for name in settings.class_of(e["name"])})


def hand_made(folder, campaigns, verdicts, *, development=False, tiers=("M",)):
    """A pack, its key and diagnoses without any simulation.

    `campaigns`: kind and effects by id; `verdicts`: content of diagnosis.json by id.
    """
    data, key, out = folder / "data", folder / "key", folder / "verdicts"
    entries = {}
    for name, (kind, effects) in campaigns.items():
        (data / name).mkdir(parents=True)
        (data / name / "trials.csv").write_text("trial\nT1\nT2\nT3\n")
        entries[name] = {
            "kind": kind,
            "engine": "mujoco",
            "effects": list(effects),
            "exclude": classes_of(effects) if kind == "unknown" else [],
            "nuisances": {},
            "where": {
                "axis": "conditions" if effects else "none",
                "weights": [1.0, 3.0, 0.0] if effects else [],
            },
            "data_sha256": folder_sha256(data / name),
        }
    settings = json.loads(json.dumps(PackSettings(development=development).to_json()))
    if tiers != ("B", "M", "T"):
        # Those are sealed by the series' interval, as in packs of `vsr2 blind make`.
        settings["tiers"] = list(tiers)
    made = {"seed": 1, "versions": {"version": "1"}}
    content = {"campaigns": entries, "settings": settings, **made}
    sealed = commitment("00ff", content)
    key.mkdir()
    write_json(key / "key.json", {"schema": KEY_SCHEMA, "salt": "00ff", "key": content})
    write_json(
        data / "pack.json",
        {
            "schema": PACK_SCHEMA,
            "development": development,
            "scene": "scene.yaml",
            "tiers": list(tiers),
            "classes": settings["classes"],
            "tolerances": settings["tolerances"],
            "campaigns": [{"id": n, "exclude": entries[n]["exclude"]} for n in sorted(entries)],
            "commitment": {"algorithm": "sha256(salt + canonical key)", "sha256": sealed},
        },
    )
    for name, content in verdicts.items():
        for tier in tiers:
            (out / name / tier).mkdir(parents=True)
            write_json(out / name / tier / "diagnosis.json", content)
    write_json(out / "submission.json", {"pack": sealed, "campaigns": 150, "seed": 0})
    return data, key, out


def make(study, folder, seed=1, **changes):
    settings = PackSettings(**(SMALL | {"single": 6, "none": 3, "pair": 2, "unknown": 3} | changes))
    return make_pack(study, folder, folder / "key", settings, seed=seed)


def protocol(settings):
    rng = np.random.default_rng(3)
    return draw_protocol(rng, catalogue(3, settings.catalogue), [6.0] * 5, settings)


def same_folders(one, two):
    return folder_sha256(one) == folder_sha256(two)


def pulses(seed, count):
    """Short ground motions."""
    time = np.arange(0.0, 1.2, 0.005)
    out = []
    for i in range(count):
        f = 1.2 + 0.3 * i
        moved = np.sin(np.pi * time / time[-1]) ** 4 * np.cos(2 * np.pi * f * time + seed)
        peak = np.abs(np.diff(moved, 2)).max() / 0.005**2
        out.append(GroundMotion(f"M{i + 1}", 0.005, moved / peak))
    return out


def stand_in(monkeypatch, diagnosis):
    """Packs are diagnosed by something quick, campaigns of a few trials too."""
    few = replace(observations.OBSERVED, least_trials=3, least_motions=1)
    monkeypatch.setattr(observations, "OBSERVED", few)
    monkeypatch.setattr("vsr2.diagnosis.diagnose", diagnosis)


ALTERED_SUBMISSIONS: dict[str, dict[str, object] | None] = {
    "campaigns is True, which no run writes; get it back": {"campaigns": True},
    "campaigns is -5, which no run": {"campaigns": -5},
    "campaigns is .200., which no run": {"campaigns": "200"},
    "campaigns is nan, which no run": {"campaigns": float("nan")},
    r"seed is \[0\], which no run": {"seed": [0]},
    "held_out is 1, which no run": {"held_out": 1},
    "was begun with pack .0000.*, not .*; continue with the same": {"pack": "0" * 64},
    "cannot be read; .*: get it back from a copy": None,
}
"""Keys of a `submission.json` altered by hand, by what is said of them; None: cut short."""


def assert_pack_refused(changes, message, folder):
    """A changed pack is refused before anything is written."""
    data, _ = write_pack(folder)
    change_pack(data, **changes)
    with pytest.raises(BlindError, match=rf"pack\.json: {message}"):
        diagnose_pack(data, folder / "out")
    assert not (folder / "out").exists()
