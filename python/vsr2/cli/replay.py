"""`vsr2 view`: a trial as a 3-D replay in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `view`."""
    view = verbs.add_parser(
        "view",
        help="replay a trial in 3-D in the browser",
        description="Serve an interactive 3-D replay of one trial; open the printed address in a "
        "browser, on this machine or through a forwarded port. No screen is needed here.",
    )
    view.add_argument("result", metavar="RESULT", type=Path, help="folder written by `vsr2 run`")
    view.add_argument("--trial", type=int, default=0, help="index of the trial (default 0)")
    view.add_argument("--port", type=int, default=8080)
    view.add_argument("--host", default="127.0.0.1")
    view.set_defaults(run=_view)


def _view(options: argparse.Namespace) -> int:
    raise NotImplementedError
