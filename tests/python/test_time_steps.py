"""Which time step a study can do with."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from vsr2 import Study
from vsr2.analysis import TimeStepError, compare_time_steps, longest_time_step
from vsr2.cli.main import main
from vsr2.errors import SimulationError

BLOCK = {
    "name": "block",
    "rock": {"shape": "box", "size": [0.2, 0.2, 0.6], "mass": 60.0},
    "motion": {
        "mode": "grid_cosine",
        "pga_g": {"min": 0.5, "max": 0.8, "step": 0.15},
        "pgv_pga_s": {"min": 0.06, "max": 0.12, "step": 0.03},
    },
}


def row(step: float, change: float, error: float) -> TimeStepError:
    return TimeStepError(step, 20, change, error, 0.1, 0.01)


def test_the_longest_step_keeps_the_tolerance_with_two_standard_errors() -> None:
    found = [row(0.0005, 0.0, 0.0), row(0.001, -0.005, 0.002), row(0.002, 0.012, 0.005)]
    assert longest_time_step(found, 0.02) == 0.001  # 0.012 + 2 * 0.005 is above 0.02
    assert longest_time_step(found, 0.0221) == 0.002
    assert longest_time_step(found, 0.0089) is None


def test_a_longer_step_does_not_count_beyond_one_that_fails() -> None:
    found = [row(0.0005, 0.0, 0.0), row(0.001, 0.5, 0.01), row(0.002, 0.0, 0.001)]
    assert longest_time_step(found, 0.02) is None


def test_margins_of_a_block_do_not_depend_on_the_step_beyond_its_scatter() -> None:
    # Single cosines and a slender block: the response is hardly chaotic, and 1 ms is converged. A
    # halving leaves 2 / 2^7 = 0.016 at either step, so that a mean of nine is good to 0.008.
    first, second = compare_time_steps(Study.from_dict(BLOCK), (0.001, 0.0005))
    assert (first.time_step, second.time_step) == (0.0005, 0.001)
    assert first.margin_change == first.standard_error == first.scatter == 0.0
    assert abs(second.margin_change) < 0.016 + 2 * second.standard_error
    assert second.standard_error < 0.02
    assert second.motions == 9
    assert second.cpu_time < first.cpu_time


def test_margins_beyond_the_range_are_not_made_up() -> None:
    calm = BLOCK | {"motion": BLOCK["motion"] | {"pga_g": {"min": 0.01, "max": 0.03, "step": 0.01}}}
    with pytest.raises(SimulationError, match=r"0 of 9 motions overturn .*motion\.scale"):
        compare_time_steps(Study.from_dict(calm), (0.001, 0.002))


@pytest.mark.parametrize("steps", [(0.001,), (0.001, 0.001), (0.0, 0.001)])
def test_time_steps_that_cannot_be_compared_are_refused(steps: tuple[float, ...]) -> None:
    with pytest.raises(SimulationError, match="at least two"):
        compare_time_steps(Study.from_dict(BLOCK), steps)


def test_no_replicate_is_refused() -> None:
    with pytest.raises(SimulationError, match="replicates is 0"):
        compare_time_steps(Study.from_dict(BLOCK), replicates=0)


def test_the_verb_names_the_step_and_how_to_use_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = tmp_path / "block.yaml"
    study.write_text(json.dumps(BLOCK))  # JSON is YAML
    asked = ["config", "time-step", str(study), "--replicates", "1"]
    assert main([*asked, "--tolerance", "1"]) == 0
    assert "--set engine.time_step=0.004" in capsys.readouterr().out
    assert main([*asked, "--tolerance", "1e-9", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["longest_time_step"] is None
    assert [one["time_step"] for one in said["time_steps"]] == [
        0.00025,
        0.0005,
        0.001,
        0.002,
        0.004,
    ]
    assert all(math.isfinite(one["margin_change"]) for one in said["time_steps"])
    assert main([*asked, "--tolerance", "0"]) != 0
    assert "--tolerance is 0" in capsys.readouterr().err
