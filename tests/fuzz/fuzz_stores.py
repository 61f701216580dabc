"""Stores of finished work for the fuzz command: sound files, and what reads them."""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

DIGEST = "0" * 64
NAMES = ("friction", "wear")


def read_journal(path: Path) -> None:
    from vsr2.results import FLOAT_COLUMNS
    from vsr2.results.journal import JOURNAL_FILE, read_journal

    folder = beside(path, JOURNAL_FILE)
    for row in read_journal(folder, "plan", 3).values():
        assert not any(math.isinf(row[name]) for name in FLOAT_COLUMNS)


def read_evaluations(path: Path) -> None:
    from vsr2.calibration import EvaluationStore
    from vsr2.calibration.evaluation_store import EVALUATIONS_FILE

    with EvaluationStore(beside(path, EVALUATIONS_FILE), "campaign", 3) as store:
        for key in ("0", "1"):
            found = store.by_key(key)
            assert found is None or math.isfinite(found.seconds)


def read_simulations(path: Path) -> None:
    from vsr2.ensemble.simulated.cache import SimulationCache

    file = beside(path, "simulations.jsonl") / "simulations.jsonl"
    with SimulationCache(simulator(), file) as cache:
        assert math.isfinite(cache.cost)


def read_custodian(path: Path) -> None:
    from vsr2.blind.custodian.steps import PackState
    from vsr2.blind.form.reader import parsed
    from vsr2.blind.form.seal import read_json

    state = parsed(PackState, read_json(path), str(path))
    bytes.fromhex(state.salt)
    int(state.seed)


def read_steps(path: Path) -> None:
    from vsr2.blind.custodian.steps import ENTRY, LIMIT, NUMBER, Steps, numbers
    from vsr2.errors import BlindError

    def not_there() -> None:
        raise BlindError("is to be done")

    steps = Steps(path)
    for label, wanted in (
        ("campaign c0", ENTRY),
        ("detection limit", LIMIT),
        ("signal", NUMBER),
        ("amplitudes", numbers(3)),
    ):
        steps.once(label, not_there, wanted)


def read_round(path: Path) -> object:
    from vsr2.config import study_from_mapping
    from vsr2.diagnosis.iteration import FILE, _finished

    motion = {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1.0}
    rock = {"shape": "box", "size": [1.0, 1.0, 1.0], "density": 2700.0}
    study = study_from_mapping({"name": "a", "rock": rock, "motion": motion}, base=path.parent)
    return _finished(beside(path, FILE), study, DIGEST)


def read_posterior(path: Path) -> object:
    from vsr2.posterior.files import load_posterior

    return load_posterior(path, chosen_library(), (2, 1))


READ: dict[str, Callable[[Path], object]] = {
    ".journal": read_journal,
    ".evaluations": read_evaluations,
    ".simulations": read_simulations,
    ".custodian": read_custodian,
    ".steps": read_steps,
    ".round": read_round,
    ".posterior": read_posterior,
}
"""By the suffix of the input."""


def read_store(path: Path) -> None:
    READ[path.suffix](path)


def beside(path: Path, name: str) -> Path:
    """The folder in which the input has the name of its kind."""
    folder = path.parent / "store"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    shutil.copy(path, folder / name)
    return folder


def store_seeds() -> list[tuple[str, bytes]]:
    """A sound file of each kind, made by what writes it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        journal, evaluations, simulations = stores(folder)
        made = [
            (".journal", journal),
            (".evaluations", evaluations),
            (".simulations", simulations),
            (".posterior", posterior(folder / "posterior.npz")),
        ]
    entry = {
        "kind": "single", "engine": "mujoco", "protocol": 0, "exclude": ["wear"],
        "data_sha256": DIGEST, "flips": 0.25,
        "effects": [
            {"name": "friction", "strength": "factor", "values": {"factor": 1.2}, "null": 1.0,
             "relative": 2.0}
        ],
        "where": {"axis": "conditions", "weights": [0.0, 1.5, 0.25]},
        "nuisances": {"input_gain": 1.01},
    }  # fmt: skip
    steps = {
        "campaign c0": entry,
        "detection limit": None,
        "signal": 1.5,
        "amplitudes": [4.0, 5.0, 6.5],
    }
    state = {"form": 8, "seed": "12", "salt": DIGEST, "settings": {"single": [6]}}
    finished = {
        "provenance": {"asked": DIGEST},
        "gap": dict.fromkeys(("before", "floor", "excess", "closure", "headline"), 0.5),
        "corrected": {"effects": {"wear": {"change": 0.1}}},
        "verdict": {"kind": "effect", "effects": ["wear"], "probability": 0.9},
        "none_probability": 0.1,
    }
    for suffix, content in ((".steps", steps), (".custodian", state), (".round", finished)):
        made.append((suffix, json.dumps(content, indent=1).encode()))
    return made


def simulator() -> Any:
    """Answers without simulating."""
    import numpy as np

    from vsr2.ensemble.simulated.simulator import Responses

    def run(requests: list[Any]) -> Responses:
        count = len(requests)
        return Responses(np.zeros(count), np.full(count, 0.1), np.ones((count, 2)))

    return SimpleNamespace(
        identity="made", library={}, nuisance_draw=lambda index: np.zeros(1), run=run
    )


def stores(folder: Path) -> list[bytes]:
    """Contents of journal, evaluations and simulations."""
    import numpy as np

    from vsr2.calibration import Evaluation, EvaluationStore
    from vsr2.ensemble.simulated.cache import SimulationCache
    from vsr2.ensemble.simulated.simulator import Request
    from vsr2.results import FLOAT_COLUMNS, Journal

    words = {"status": "ok", "outcome": "rocked", "message": "", "engine": "fast"}
    row = {**dict.fromkeys(FLOAT_COLUMNS, 0.125), **words, "hand_over": "none", "steps": 7}
    with Journal(folder, "plan", 3) as journal:
        journal.record(0, row, {"bytes": 100, "sha256": DIGEST})
        journal.record(2, row | {"overturning_time": math.nan})
    with EvaluationStore(folder, "campaign", 3) as store:
        for i in range(2):
            ends = np.array([1.0, 0.0, math.nan])
            store.keep(str(i), Evaluation({"p": 0.5 * i, "word": "a"}, ends, f"plan {i}", 1.5))
    with SimulationCache(simulator(), folder / "simulations.jsonl", chunk=2) as cache:
        cache.run([Request(i, (), 0, 1) for i in range(4)])
    names = ("journal.jsonl", "evaluations.jsonl", "simulations.jsonl")
    return [(folder / name).read_bytes() for name in names]


def chosen_library() -> Any:
    """Few effects, by name."""
    from vsr2.effects import library

    known = library()
    return {name: known[name] for name in NAMES}


def posterior(path: Path) -> bytes:
    """A file of a posterior; its numbers mean nothing."""
    import numpy as np

    from vsr2.ensemble.simulated.library import free_parameters
    from vsr2.posterior.calibration import Levels
    from vsr2.posterior.discrepancy_size import DiscrepancySize
    from vsr2.posterior.effect_curves import Curves
    from vsr2.posterior.files import save_posterior
    from vsr2.posterior.network import Network
    from vsr2.posterior.outside import Outside
    from vsr2.posterior.parameters import Parameters
    from vsr2.posterior.second_cause import SecondCause
    from vsr2.posterior.sets import Sets, declared_alike
    from vsr2.posterior.summaries import Standard, Summaries
    from vsr2.posterior.training import Posterior
    from vsr2.posterior.within_library import WithinLibrary

    library = chosen_library()
    sets = Sets(NAMES)
    # 2 trials with a feature each, so 4 columns; 3 discriminants; 3 + 3 * 2 summaries.
    columns, row = np.ones((3, 4)), np.array([0, 2])
    summaries = np.ones(9)
    free = {name: len(free_parameters(effect)) for name, effect in library.items()}
    curves = Curves(np.eye(3), np.ones(3), np.ones((2, 5, 3)), np.ones((2, 5)))
    within = WithinLibrary(
        sets=sets,
        alike=declared_alike(library),
        summaries=Summaries(
            np.ones((2, 4, 3)), np.ones((2, 3)), columns, np.ones(3), np.array([0, 1, -1]), 2
        ),
        centre=summaries,
        scale=summaries,
        # As many inputs as summaries, and outputs of which the sets are made.
        networks=(Network(sets, [np.ones((9, 6))], [np.ones(6)]),),
        curves=(curves,),
        judges=(SecondCause(curves, np.ones(21), np.ones(22)),),
        temperature=1.0,
    )
    save_posterior(
        Posterior(
            standard=Standard(np.full(2, 0.5), np.ones((2, 1)), np.ones((2, 1))),
            within=within,
            outside=Outside.prior(2),
            levels=Levels(0.2, 0.5, 0.5, 0.9, 0.8, 0.91, 0.05, 0.6, 0.7),
            parameters=Parameters(
                library,
                columns.astype(np.float32),
                dict.fromkeys(NAMES, row),
                {name: np.ones((2, count)) for name, count in free.items()},
            ),
            discrepancy=DiscrepancySize(0.0, summaries, np.array([-0.1, 0.0, 0.1])),
            gap_free=columns,
            misfits=np.ones(3),
            campaigns=150,
            trained_on=150,
        ),
        path,
    )
    return path.read_bytes()
