"""Tables for the terminal."""

from __future__ import annotations

import numpy as np

from synthetic_results import make_result
from vsr2.report import printable, summary_table


def test_summary_counts_outcomes_statuses_and_time() -> None:
    result = make_result(
        [None] * 4,
        outcome=np.array(["overturned", "stable", "stable", "failed"], dtype=object),
        status=np.array(["ok", "ok", "tail_timeout", "error"], dtype=object),
        message=np.array(["", "", "", "mesh\nlost"], dtype=object),
        simulated_time=np.array([1.0, 2.0, 3.5, np.nan]),
        steps=np.array([1000, 2000, 3500, 0]),
        provenance={"wall_time_s": 2.0, "threads": 1, "interrupted": True},
    )
    lines = summary_table(result).splitlines()
    assert lines[0] == "4 trials"
    assert "  stable                 2   50.0 %" in lines
    assert "  overturned             1   25.0 %" in lines
    assert not any("rocked" in line for line in lines)
    late, why = [line for line in lines if "tail_timeout" in line]
    assert late.startswith("  tail_timeout           1   25.0 %  not at rest in the end")
    assert why.startswith("  trial 2 (trial 2), tail_timeout: the rock was still moving 3.5 s")
    assert "  trial 3 (trial 3), error: mesh?lost" in lines
    assert "  6.5 s simulated, 6500 time steps, 2 s on the clock, 3250 steps/s, 1 thread" in lines
    assert "interrupted" in lines[-1]


def test_summary_says_which_engines_ran() -> None:
    engines = np.array(["fast", "fast", "fast", ""], dtype=object)
    handed = np.array(["none", "off_the_top", "none", "none"], dtype=object)
    result = make_result([None] * 4, engine=engines, hand_over=handed)
    lines = summary_table(result).splitlines()
    start = lines.index("engine")
    assert lines[start + 1].split() == ["fast", "2", "50.0", "%"]
    assert lines[start + 2].startswith("  fast, then exact (off the top)")
    assert lines[start + 2].split()[-3:] == ["1", "25.0", "%"]
    assert lines[start + 3] == ""


def test_summary_of_nothing_and_of_one() -> None:
    assert summary_table(make_result([])).splitlines()[:4] == ["0 trials", "", "outcome", "  none"]
    assert summary_table(make_result([None])).startswith("1 trial\n")


def test_summary_bounds_the_failures_it_shows() -> None:
    result = make_result([None] * 30, message=np.array(["bad"] * 30, dtype=object))
    text = summary_table(result)
    assert text.count(": bad") == 10
    assert "and 20 more" in text


def test_what_cannot_be_shown_is_replaced() -> None:
    assert printable("a\x1b[1m\n\udcff é 漢") == "a?[1m?? é 漢"
