"""The study of a block that several tests of worlds step."""

from __future__ import annotations

from vsr2.config.study import Study


def study(**sections: object) -> Study:
    return Study.model_validate(
        {
            "rock": {"shape": "box", "size": [0.3, 0.5, 1.0], "density": 2700.0},
            "motion": {"mode": "single_cosine", "pga_g": 0.5, "pgv_pga_s": 0.1},
            **sections,
        }
    )
