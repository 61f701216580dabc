"""What tells the code of a user's effect from another of its name."""

from __future__ import annotations

import inspect
import marshal
from functools import cache


def own_code(kind: type) -> str:
    """What tells a user's class from another of its name; empty for classes of this package.

    Its source and that of its bases outside this package; of classes without one (typed in at a
    prompt) the bytecode of their functions. What they call elsewhere is not looked at.
    """
    return "".join(_code(base) for base in kind.__mro__ if base is not object)


@cache
def _code(kind: type) -> str:
    if kind.__module__.split(".")[0] == __name__.split(".")[0]:
        return ""
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):
        codes = [getattr(value, "__code__", None) for _, value in sorted(vars(kind).items())]
        return "".join(marshal.dumps(code).hex() for code in codes if code is not None)
