"""Results, hazard curves, calibrations and fragility studies for the fuzz command.

Sound files of each, and what reads them, by reader and suffix of the input.
"""

from __future__ import annotations

import csv
import io
import math
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SITE = (-117.1, 34.2)
CURVE = (
    "#,,,,\"generated_by='OpenQuake engine 3.16.3', start_date='2024-01-01T00:00:00', "
    "checksum=1, kind='mean', investigation_time=50.0, imt='PGA'\"\n"
    "lon,lat,depth,poe-0.1000000,poe-0.2000000,poe-0.4000000,poe-0.8000000\n"
    "-117.10000,34.20000,0.00000,9.932621E-01,3.934693E-01,4.877058E-02,0.000000E+00\n"
)
OTHER_SITE = "-118.00000,34.20000,0.00000,9.0E-01,3.0E-01,4.0E-02,1.0E-03\n"
COSINES = """\
name: fragile
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0, start: {mode: yaw, yaw: 20.0}}
motion:
  mode: grid_cosine
  pga_g: {min: 0.1, max: 0.6, step: 0.1}
  pgv_pga_s: {min: 0.1, max: 0.2, step: 0.05}
effects: {table_gain: {change: 0.02}}
fragility:
  measures: [pga_g, pgv_pga_s]
  azimuths: [0.0, 90.0, 180.0]
  replicates: 2
  jitter: {yaw: 5.0, offset: 0.005, tilt: 0.05}
"""
LOGGED = """\
name: logged
engine: {mode: fast, time_step: 0.004}
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion: {mode: single_cosine, pga_g: 0.4, pgv_pga_s: 0.1}
settling: {window: 0.01}
outcome: {rest_window: 0.01, tail: 0.1}
effects: {table_pitch: {compliance: 0.01}}
output: {log_every: 20, contacts_every: 60, figures: false}
"""


def read_curve(path: Path) -> None:
    """What `vsr2 hazard` does with a curve, for a file of one site and of several."""
    from vsr2.errors import Vsr2Error
    from vsr2.hazard import read_hazard_curve

    for site in (None, SITE):
        with suppress(Vsr2Error):
            judge(read_hazard_curve(path, site=site), lognormal())


def read_fit(path: Path) -> None:
    """What `vsr2 hazard` does with the folder of a fragility study."""
    from vsr2.hazard import HazardCurve, read_lognormal

    curve = HazardCurve("pga_g", [0.1, 0.2, 0.4], [1e-2, 1e-3, 1e-4])
    judge(curve, read_lognormal(beside(path, {"lognormal.csv": path.read_bytes()}), "pga_g"))


def judge(curve: Any, fit: Any) -> None:
    """Rates and ages, which are numbers or are refused."""
    from vsr2.hazard import excluded_age, rate_draws, survival

    rates = rate_draws(curve, fit)
    low, high = rates.interval()
    # Before: of a rate that is 0 no age is excluded, which is refused.
    ages = [excluded_age(one, 0.95) for one in (rates.draws, low, high)]
    found = (rates.rate, low, high, *ages, survival(rates.draws, 1000.0))
    assert all(math.isfinite(one) for one in found), found
    assert low <= high, (low, high)


def lognormal() -> Any:
    """A fit whose numbers mean nothing."""
    from vsr2.fragility import Lognormal

    return Lognormal(0.4, 0.35, 0.46, 0.3, 0.2, 0.4, fits=True)


def fit_table() -> bytes:
    """A table of `vsr2 fragility`, of two curves of which one has no fit."""
    row = {"measure": "pga_g", "azimuth_deg": "all", **vars(lognormal())}
    row |= {"fits": 1, "trials": 288, "overturned": 100, "motions": 12, "separated": 0, "note": ""}
    blank = row | dict.fromkeys(vars(lognormal()), "") | {"azimuth_deg": "90", "note": "none"}
    text = io.StringIO()
    table = csv.DictWriter(text, fieldnames=list(row), lineterminator="\n")
    table.writeheader()
    table.writerows([row, blank])
    return text.getvalue().encode()


def read_result(path: Path) -> None:
    """Reads a sound result in which `path` takes the place of the file of its kind."""
    from vsr2 import load_result
    from vsr2.errors import Vsr2Error
    from vsr2.results import finished_plan, is_result, lost_logs

    taken = {KINDS[path.suffix]: path.read_bytes()}
    folder = beside(path, sound_result() | taken)
    is_result(folder)
    for look in (finished_plan, lost_logs):
        with suppress(Vsr2Error):
            look(folder)
    result = load_result(folder)
    assert len(result.logs) == len(result)
    repr(result)
    str(dict(result.facts))
    for log in result.logs:
        if log is not None:
            str(dict(log.facts))
            assert len(log.roll_pitch_yaw) == len(log.turn) == len(log.time)


KINDS = {
    ".csv": "trials.csv",
    ".json": "provenance.json",
    ".npz": "logs/000001.npz",
}
"""The file that an input of this suffix takes the place of."""


@cache
def sound_result() -> dict[str, bytes]:
    """Files of a result of two trials by their paths; the pedestal pitches, so logs have all."""
    from dataclasses import replace

    from vsr2.config import load_study
    from vsr2.results import save_result
    from vsr2.simulation import run_batch, study_trials

    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "study.yaml").write_text(LOGGED)
        [trial] = study_trials(load_study(Path(name) / "study.yaml"))
        out = save_result(run_batch([trial, replace(trial, seed=1)], threads=1), Path(name) / "out")
        files = {str(path.relative_to(out)): path for path in out.rglob("*") if path.is_file()}
        return {file: path.read_bytes() for file, path in files.items()}


def read_calibration(path: Path) -> None:
    from vsr2.calibration import load_calibration
    from vsr2.config import dump_study

    (path.parent / "known").mkdir(exist_ok=True)
    dump_study(load_calibration(path).study)


def read_fragility(path: Path) -> None:
    from vsr2.config import dump_study
    from vsr2.fragility import load_fragility

    dump_study(load_fragility(path).study)


def study_seeds(*files: str) -> list[tuple[str, bytes]]:
    """Studies of the repository; what they name lies beside the input."""
    made = []
    for file in files:
        text = (ROOT / file).read_text()
        for old, new in (
            ("../out/lab/models/SP1.obj", "tetra.obj"),
            ("../models/pbr_scan.obj", "tetra.obj"),
            ("../out/lab", "known"),
            ("../out/known", "known"),
            ("folder: motions", "folder: ."),
        ):
            text = text.replace(old, new)
        made.append((".yaml", text.encode()))
    return made


READ: dict[str, dict[str, Callable[[Path], None]]] = {
    "hazard": {".csv": read_curve, ".lognormal": read_fit},
    "result": dict.fromkeys(KINDS, read_result),
    "calibration": {".yaml": read_calibration},
    "fragility": {".yaml": read_fragility},
}
"""By reader and suffix of the input."""


def result_seeds(reader: str) -> list[tuple[str, bytes]]:
    """A sound file of each kind."""
    match reader:
        case "hazard":
            curves = (CURVE, CURVE + OTHER_SITE)
            return [*((".csv", one.encode()) for one in curves), (".lognormal", fit_table())]
        case "result":
            return [(suffix, sound_result()[file]) for suffix, file in KINDS.items()]
        case "calibration":
            names = ("lab_calibration", "lab_sequential", "lab_start")
            return study_seeds(
                "configs/calibration.yaml", *(f"studies/{name}.yaml" for name in names)
            )
    return [*study_seeds("configs/fragility.yaml"), (".yaml", COSINES.encode())]


def beside(path: Path, files: dict[str, bytes]) -> Path:
    """A new folder beside the input that holds these files."""
    folder = path.parent / "folder"
    shutil.rmtree(folder, ignore_errors=True)
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder
