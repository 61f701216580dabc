"""Studies with sections of their own: read together, rebuilt with other values."""

from __future__ import annotations

import pytest
from pydantic import Field

from vsr2.config.extended import load_extended
from vsr2.config.section import Section
from vsr2.errors import ConfigError


class Own(Section):
    deep: dict[str, int] = Field(default_factory=dict)
    level: int = 1


STUDY = """
level: 3
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion: {mode: single_cosine, pga_g: 0.3, pgv_pga_s: 0.1}
"""


def load(tmp_path, text=STUDY, **options):
    path = tmp_path / "study.yaml"
    path.write_text(text)
    return load_extended(path, Own, **options)


def test_values_are_put_into_a_fresh_study(tmp_path):
    found = load(tmp_path)
    assert found.own.level == 3
    made = found.with_values({"rock.size.0": 0.3, "engine.solver_iterations": 50, "seed": 4})
    assert made.rock.size == (0.3, 0.5, 1.0)
    assert made.engine.solver_iterations == 50
    assert made.seed == 4
    assert found.study.rock.size == (0.25, 0.5, 1.0)
    assert found.with_values({}) == found.study
    assert found.value("rock.size.2") == 1.0
    assert found.value("contact.rock.stiffness") == 2.6e9


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ({"rock.size.3": 1.0}, "'3' is no place in a list of 3"),
        ({"rock.size.0.1": 1.0}, "is no section"),
        ({"rock.sice": 1.0}, r"rock.sice.*did you mean `size`"),
        ({"engine.time_step": -1.0}, r"engine.time_step = -1.0: engine.time_step: must be"),
        ({"engine.solver_iterations": 2.5}, "whole number"),
    ],
)
def test_values_that_cannot_be_are_named(tmp_path, values, match):
    with pytest.raises(ConfigError, match=match):
        load(tmp_path).with_values(values)


def test_overrides_reach_both_parts(tmp_path):
    found = load(tmp_path, overrides=["level=5", "seed=9"])
    assert (found.own.level, found.study.seed) == (5, 9)


def test_problems_are_reported_by_line_for_either_part(tmp_path):
    with pytest.raises(ConfigError, match=r"study.yaml:2: level: must be a valid integer|level"):
        load(tmp_path, STUDY.replace("level: 3", "level: high"))
    with pytest.raises(ConfigError, match=r"study.yaml:2: levle: .*did you mean `level`"):
        load(tmp_path, STUDY.replace("level: 3", "levle: 3"))
    with pytest.raises(ConfigError, match=r"study.yaml:4: motion.mode: must be"):
        load(tmp_path, STUDY.replace("single_cosine", "double_cosine"))
