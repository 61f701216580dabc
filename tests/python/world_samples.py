"""The study of a block that several tests of worlds step, and its contact."""

from __future__ import annotations

from vsr2 import _native
from vsr2.config.study import Contact, Study


def study(**sections: object) -> Study:
    return Study.model_validate(
        {
            "rock": {"shape": "box", "size": [0.3, 0.5, 1.0], "density": 2700.0},
            "motion": {"mode": "single_cosine", "pga_g": 0.5, "pgv_pga": 0.1},
            **sections,
        }
    )


def pair_values(contact: Contact) -> _native.ContactValues:
    """Values in force between rock and pedestal (supplement Eq. 1; Eq. 2 where both are equal)."""
    rock, pedestal = (
        _native.ContactValues(**one.model_dump()) for one in (contact.rock, contact.pedestal)
    )
    return _native.combine(a=rock, b=pedestal)
