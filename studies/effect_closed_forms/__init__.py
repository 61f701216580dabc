"""Closed forms, conservation laws and independent computations that the library's effects meet.

One function an effect, of its name and marked by `closed_form`: it takes the effect and a bench and
gives the checks. `tests/python/test_effects_library.py` holds each effect to them;
`studies/check_effects.py` counts them. They stand outside the package, because an installed VSR2
never runs them. An effect of one's own has its checks in its own `verify`.
"""

from effect_closed_forms import bodies, course, ground_motion
from effect_closed_forms.block import half_widths, uplift_acceleration
from effect_closed_forms.forms import FORMS, closed_forms

__all__ = [
    "FORMS",
    "bodies",
    "closed_forms",
    "course",
    "ground_motion",
    "half_widths",
    "uplift_acceleration",
]
