"""A pack of others with its diagnoses, written from docs/reference/blind.md alone.

Only the version of diagnoses is the code's, so that it rises in one place.
"""

import copy
import csv
import hashlib
import json
import math
from pathlib import Path

import numpy as np

from vsr2.diagnosis.verdict.document import SCHEMA

SALT = "5a17"

TRIALS = ("run-b", "run-a", "extra.1")

SCENE = """\
name: hall
rock: {shape: mesh, file: boulder.obj, density: 2600}
motion: {mode: single_cosine, amplitude: 0.05, frequency: 1.0}
"""

SCENE_CONTENT = {
    "name": "hall",
    "rock": {"shape": "mesh", "file": "boulder.obj", "density": 2600},
    "motion": {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1.0},
}

KEY = {
    "settings": {
        "classes": [["rope", "chain"]],
        "tiers": ["B", "M"],
        "tolerances": {"width": 0.03, "height": 0.04, "input_gain": [0.004, 0.004]},
    },
    "campaigns": {
        "Hall.1": {
            "kind": "single",
            "engine": "chrono",
            "protocol": 2,
            "effects": [
                {
                    "name": "rope",
                    "values": {"slack": 8.0},
                    "strength": "slack",
                    "null": None,
                    "relative": 2.5,
                }
            ],
            "exclude": ["wind"],
            "where": {"axis": "conditions", "weights": [1.0, 3.0, 0.5]},
        },
        "Hall.2": {
            "kind": "none",
            "engine": "shake table",
            "effects": [],
            "where": {"axis": "none", "weights": []},
        },
        "hall-3": {
            "kind": "unknown",
            "engine": "shake table",
            "effects": [{"name": "wind", "values": {"v": 2.0}, "strength": "v", "null": 0.0}],
            "exclude": ["wind"],
            "where": {"axis": "order", "weights": []},
        },
    },
}

VERDICTS = {
    # The true class by its other member, and 9 for a slack of 8 and none at infinity.
    "Hall.1": {
        "schema": SCHEMA,
        "verdict": {"kind": "effect", "effects": ["chain"], "probability": 0.8},
        "effects": [
            {"name": "chain", "probability": 0.6},
            {
                "name": "rope",
                "probability": 0.2,
                "parameters": {"slack": {"mean": 9.0, "ci90": [7.0, 11.0]}},
            },
        ],
        "none_probability": 0.1,
        "unknown": {"probability": 0.05},
        "gap": {
            "closure": {"value": 0.4, "ci95": [0.1, 0.6]},
            "headline": {"value": 0.3, "ci95": [0.1, 0.5]},
            "gain": {"value": 0.2, "ci95": [0.1, 0.3]},
        },
        "conformal_set_90": ["chain", "rope"],
        "where": [{"axis": "conditions", "p_familywise": 0.01, "trials": ["run-a", "extra.1"]}],
    },
    "Hall.2": {
        "schema": SCHEMA,
        "verdict": {"kind": "none", "effects": [], "probability": 0.9},
    },
    "hall-3": {
        "schema": SCHEMA,
        "verdict": {"kind": "unknown", "probability": 0.7},
        "effects": [{"name": "chain", "probability": 0.2}],
        "unknown": {"probability": 0.7},
        "conformal_set_90": ["unknown"],
    },
}


def sha256(content):
    return hashlib.sha256(content).hexdigest()


def plain(content):
    return json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True).encode()


def folder_hash(folder):
    lines = [
        f"{path.relative_to(folder).as_posix()}\0{sha256(path.read_bytes())}\n"
        for path in sorted(p for p in folder.rglob("*") if p.is_file())
    ]
    return sha256("".join(lines).encode())


def write_campaign(folder):
    (folder / "motions").mkdir(parents=True)
    np.savez(
        folder / "motions" / "pulse.npz",
        sample_interval_s=0.01,
        displacement_m=0.05 * np.sin(np.linspace(0.0, math.pi, 32)) ** 2,
    )
    (folder / "campaign.yaml").write_text(
        f"schema: vsr2.campaign/1\nname: {folder.name}\nspecimens: {{boulder: {{}}}}\n"
    )
    with (folder / "trials.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(
            ["order", "trial", "motion", "motion_file", "session", "specimen", "overturned",
             "peak_tilt_rad"]
        )  # fmt: skip
        for order, trial in enumerate(TRIALS):
            rows.writerow([10 * order, trial, "pulse", "pulse", "May", "boulder", order % 2, 0.3])


def write_pack(folder, key=KEY, pack=None):
    """Data and key folder; `pack` replaces keys of pack.json."""
    data, kept = folder / "data", folder / "kept"
    data.mkdir(parents=True)
    kept.mkdir()
    (data / "scene.yaml").write_text(SCENE)
    corners = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.3, 0.3) for z in (0.0, 1.0)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    model = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    (data / "boulder.obj").write_text(model + "".join(f"f {face}\n" for face in faces))
    key = copy.deepcopy(key)
    for name, entry in key["campaigns"].items():
        write_campaign(data / name)
        entry.setdefault("data_sha256", folder_hash(data / name))
    key.setdefault("scene_sha256", sha256(plain(SCENE_CONTENT)))
    key.setdefault("model_sha256", sha256((data / "boulder.obj").read_bytes()))
    seal(data, kept, key)
    content = {
        "schema": "vsr2.blind-pack/1",
        "scene": "scene.yaml",
        "tiers": ["B", "M"],
        "classes": [["chain", "rope"]],
        "tolerances": KEY["settings"]["tolerances"],
        "campaigns": [
            {"id": "Hall.1", "protocol": 2, "exclude": ["wind"]},
            {"id": "Hall.2"},
            {"id": "hall-3", "exclude": ["wind"]},
        ],
        "commitment": json.loads((data / "pack.json").read_text())["commitment"],
    }
    (data / "pack.json").write_text(json.dumps(content | (pack or {})))
    return data, kept


def seal(data, kept, key):
    """Write the key, and its hash into pack.json."""
    (kept / "key.json").write_text(
        json.dumps({"schema": "vsr2.blind-key/1", "salt": SALT, "key": key})
    )
    path = data / "pack.json"
    content = json.loads(path.read_text()) if path.exists() else {}
    hashed = sha256(bytes.fromhex(SALT) + plain(key))
    content["commitment"] = {"algorithm": "sha256(salt + canonical key)", "sha256": hashed}
    path.write_text(json.dumps(content))


def change_pack(data, **changes):
    path = data / "pack.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def write_diagnoses(data, out, verdicts=VERDICTS, tiers=("B", "M")):
    for name, content in verdicts.items():
        for tier in tiers:
            (out / name / tier).mkdir(parents=True, exist_ok=True)
            (out / name / tier / "diagnosis.json").write_text(json.dumps(content))
    hashed = json.loads((data / "pack.json").read_text())["commitment"]["sha256"]
    (out / "submission.json").write_text(json.dumps({"pack": hashed}))
    return out


class Reported:
    """A diagnosis that says what is written above."""

    calls: list = []  # noqa: RUF012

    def __init__(self, campaign, scene, **how):
        Reported.calls.append((campaign, Path(scene).name, how))
        self.content = VERDICTS[campaign.name]

    def save(self, folder):
        (folder / "diagnosis.json").write_text(json.dumps(self.content))


def a_verdict(**changes):
    return VERDICTS["Hall.1"] | changes
