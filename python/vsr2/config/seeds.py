"""Seeds: one range for all, that of a study's key, of result tables and of files."""

from __future__ import annotations

from numbers import Integral

from vsr2.config.problems import shown
from vsr2.config.section import MAX_SEED
from vsr2.errors import Vsr2Error


def checked_seed(given: object, error: type[Vsr2Error], what: str = "seed") -> int:
    """A seed as Python's own integer.

    Args:
        given: what should be one.
        error: raised where it is none.
        what: names it there.

    Raises:
        Vsr2Error: as `error`: no whole number from 0 to `MAX_SEED`.
    """
    if isinstance(given, bool) or not isinstance(given, Integral):
        raise error(f"{what} is {shown(given)}; give a whole number")
    seed = int(given)
    if seed < 0:
        raise error(f"{what} is {shown(given)}; give 0 or more")
    if seed > MAX_SEED:
        raise error(f"{what} is {shown(given)}; give at most {MAX_SEED}")
    return seed
