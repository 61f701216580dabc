"""Content of a `diagnosis.json` and rows of its trials, written by hand."""

from __future__ import annotations

from typing import Any

from vsr2.diagnosis import SCHEMA, Diagnosis


def estimate(value: float, half: float = 0.01) -> dict:
    return {"value": value, "ci95": [value - half, value + half]}


def control(closure: float, loss: float) -> dict:
    return {"closure": estimate(closure), "loss": estimate(loss)}


def effect(name: str, probability: float, acts: float) -> dict:
    size = {"mean": 0.11, "median": 0.12, "ci90": [0.06, 0.16], "ci95": [0.05, 0.17], "unit": "1"}
    return {
        "name": name,
        "probability": probability,
        "acts": acts,
        "parameters": {"size": size},
    }


def location(
    values: dict, feature: str, channel: str, phase: str, size: float, p: float, **found: Any
) -> dict:
    return {
        "location": {"kind": "intensity" if values else "all_trials", "values": values},
        "axis": "conditions",
        "feature": feature,
        "channel": channel,
        "phase": phase,
        "effect_size": size,
        "p_familywise": p,
        "concentration": 1.0,
        "concentration_ci90": [0.7, 1.4],
        "trials": None,
        **found,
    }


NONE_CAN_BE = {"value": None, "ci95": None}

GAP = {"code": "gap", "values": {"none": 0.01, "limit": 0.3}}

LOW_PGA = location(
    {"pga_g": "low"}, "outcome", "outcome", "response", 0.9, 0.004,
    concentration=2.4, concentration_ci90=[2.1, 2.9], trials=["A", "B"],
)  # fmt: skip

CONTENT = {
    "schema": SCHEMA,
    "campaign": {
        "name": "hand", "trials": 4, "tier": "T", "motions": 2, "sessions": 2,
        "responding_trials": 4,
    },
    "gap": {
        "state": "found",
        "fit": 0.004,
        "effects": ["wear"],
        "before": estimate(0.8),
        "after": estimate(0.3),
        "floor": estimate(0.2),
        "closure": estimate(0.83),
        "excess": estimate(0.6),
        "excess_after": estimate(0.1),
        "gain": estimate(0.5),
        "headline": estimate(0.5),
        "discrepancy": estimate(0.021),
        "layers": {
            "numerical": 0.02, "time_step": 0.03, "solver": None, "input": 0.04, "nuisance": 0.05,
            "physical": None, "physical_expected": None, "trials": 4, "repeats": 0,
        },
    },
    "where": [
        LOW_PGA,
        location({}, "outcome", "outcome", "response", 0.6, 0.01),
        location(
            {"pga_g": "high"}, "outcome", "outcome", "response", 0.5, 0.02, concentration=1.4
        ),
        location({}, "largest_tilt", "tilt", "strong_shaking", -0.3, 0.5),
    ],
    "verdict": {
        "kind": "effect",
        "effects": ["wear"],
        "findings": [["wear"]],
        "probability": 0.9,
        "reasons": [GAP],
    },
    "effects": [effect("wear", 0.76, 0.8), effect("catch", 0.09, 0.12)],
    "sets": [
        {"effects": ["wear"], "probability": 0.72},
        {"effects": ["unknown"], "probability": 0.1},
        {"effects": ["catch", "wear"], "probability": 0.08},
        {"effects": [], "probability": 0.05},
        {"effects": ["catch"], "probability": 0.05},
    ],
    "none_probability": 0.05,
    "conformal_set_90": ["wear"],
    "waterfall": None,
    "negative_control": {"recalibrated": control(0.17, 0.7), "dealt": control(0.33, 0.6)},
    "unknown": {"probability": 0.1, "detection_rate": 0.4},
    "posterior": {
        "temperature": 1.1, "none_limit": 0.3, "least_name": 0.85, "least_together": 0.5,
        "none_set_level": 0.95, "gap_set_level": 0.8, "known_held": 0.91, "wrong": 0.09,
        "named": 0.62, "detection_rate": 0.4, "campaigns": 2000,
    },
    "next_measurement": {
        "kind": "split",
        "splits": ["wear", "catch"],
        "instruments": ["repeat_first_trials", "slack"],
        "repetition": {"trial": "T7", "information_per_repeat": 1.0, "repeats": 3},
        "others": [
            {
                "name": "table_gain",
                "instrument": "table_sensors",
                "repetition": {"trial": "T8", "information_per_repeat": 1.0, "repeats": 4},
            },
            {
                "name": "friction",
                "instrument": "push_and_rock",
                "repetition": {"trial": "T9", "information_per_repeat": 0.0, "repeats": None},
            },
        ],
        "out_of_library": None,
    },
    "limits": [{"code": "one_session", "values": {}}],
    "corrected": {
        "effects": {"wear": {"loss": 0.08}}, "among": ["wear"],
        "scene": {"friction": {"factor": 0.8}, "wear": {"loss": 0.08}},
    },
    "provenance": {
        "versions": {"vsr2": "1"},
        "budget": {
            "state": "sufficient", "simulations": 9, "allowed": 10, "cost_s": 0.1, "simulated": 9,
            "reused": 0, "campaigns": 2000, "trials": 150,
        },
        "detection_limits": {"wear.loss +": 0.1},
        "constants": {"look": {"trials": 40}},
        "excluded": [],
        "references": [],
        "held_out": True,
        "nuisances": ["friction"],
        "simulator": "0",
        "seed": 0,
        "wall_time_s": 1.0,
    },
}  # fmt: skip

TRIALS = (
    ("A", "s1", 1, 1.0, 0, 0.9, 0.2, 2.3, 0.22),
    ("B", "s1", 2, 1.0, 1, 0.9, 0.8, 0.1, 0.22),
    ("C", "s2", 3, 1.4, 1, 0.1, 0.8, 2.3, 0.22),
    ("D", "s2", 4, 1.4, 1, 0.1, 0.8, 2.3, 0.22),
)

ROWS = tuple(
    {
        "trial": name,
        "motion": "m",
        "session": session,
        "order": order,
        "log_pga_g": pga,
        "log_pgv_pga_s": -2.0 + 0.1 * order,
        "overturned": overturned,
        "uncertain": 1,
        "before": before,
        "after": after,
        "loss_before": loss,
        "loss_after": after_loss,
        "floor": 0.1,
    }
    for name, session, order, pga, overturned, before, after, loss, after_loss in TRIALS
)


def named_throughout(name: str) -> Diagnosis:
    """A diagnosis in which all that has a name bears this one."""
    rows = [row | {"trial": name, "session": name} for row in ROWS]
    repetition = {"trial": name, "information_per_repeat": 1.0, "repeats": 1}
    measure = CONTENT["next_measurement"] | {"repetition": repetition, "splits": [name, "wear"]}
    measure["others"] = [{"name": name, "instrument": "slack", "repetition": repetition}]
    there = location(
        {"pga_g": name, "pgv_pga_s": name}, name, name, "response", 0.6, 0.01, trials=[name]
    )
    measure["out_of_library"] = {"trial": name, "tier": "M", "location": there}
    content = CONTENT | {
        "campaign": CONTENT["campaign"] | {"name": name, "tier": name},
        "gap": CONTENT["gap"] | {"effects": [name]},
        "verdict": CONTENT["verdict"] | {"effects": [name]},
        "effects": [effect(name, 0.8, 0.8)],
        "sets": [{"effects": [name], "probability": 0.8}],
        "conformal_set_90": [name],
        "where": [there],
        "next_measurement": measure,
        "provenance": {name: name},
    }
    content["effects"][0]["parameters"] = {name: content["effects"][0]["parameters"]["size"]}
    return Diagnosis(content, tuple(rows))
