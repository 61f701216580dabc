"""Diagnoses of several campaigns of one protocol: simulated and fitted once, else unchanged."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import pytest

from planar.library import PLANAR_LIBRARY
from planar.simulator import PlanarSimulator
from planted import observe, shaken_campaign
from vsr2.diagnosis import Budget, Execution, ProtocolCache, diagnose_with
from vsr2.diagnosis import diagnose as api
from vsr2.diagnosis.how_far.screened_out import SCREENED_OUT_RUNS
from vsr2.diagnosis.simulated.design import SCREENING
from vsr2.errors import DiagnosisError


def test_sharing_changes_no_diagnosis(tmp_path, monkeypatch) -> None:
    few = replace(SCREENING, least_none=12)
    monkeypatch.setattr("vsr2.diagnosis.simulated.design.SCREENING", few)
    monkeypatch.setattr("vsr2.diagnosis.which.amortised.TREES", 30)
    protocol = shaken_campaign(6, 7, duration=2.0, pga=(0.55, 1.15), session_size=14)
    truth = PlanarSimulator(protocol, seed=99)
    library = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "catch")}
    simulator = PlanarSimulator(protocol, library=library, seed=1)
    campaigns = [
        observe(protocol, truth, effects, nuisance=2) for effects in ((("catch", (0.12,)),), ())
    ]
    alone = diagnose_with(simulator, campaigns[1], budget=Budget(draws=6))

    module = sys.modules["vsr2.diagnosis.pipeline"]

    fits = []
    fit = module.prepare
    monkeypatch.setattr(module, "prepare", lambda *a, **k: fits.append(1) or fit(*a, **k))
    reuse = ProtocolCache(tmp_path / "simulations.jsonl")
    together = [
        diagnose_with(simulator, campaign, budget=Budget(draws=6), cache=reuse)
        for campaign in campaigns
    ]
    assert len(fits) == 1
    # All but the screened-out trials under what this campaign's own trials favour.
    screened_out = sum(not row["uncertain"] for row in together[1].trials)
    assert (
        together[1].content["provenance"]["budget"]["simulated"] <= SCREENED_OUT_RUNS * screened_out
    )
    assert without_cost(together[1]) == without_cost(alone)
    assert without_cost(together[0]) != without_cost(alone)


def without_cost(diagnosis):
    content = json.loads(diagnosis.to_json())
    content["provenance"].pop("wall_time_s")
    for key in ("simulated", "reused", "cost_s"):
        content["provenance"]["budget"].pop(key)
    return content


def test_too_few_draws_are_refused() -> None:
    with pytest.raises(DiagnosisError, match="at least 6"):
        api("nowhere", "nothing", budget=Budget(draws=5))


@pytest.mark.parametrize("threads", [0, -3])
def test_no_threads_are_refused(threads) -> None:
    with pytest.raises(DiagnosisError, match=f"threads is {threads}; give at least 1"):
        api("nowhere", "nothing", execution=Execution(threads=threads))
