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
        description="Serve an interactive 3-D replay of a result until Ctrl-C; open the printed "
        "address in a browser, on this machine or through a forwarded port. No screen is needed "
        "here. With --html, write the replay of one trial as a page of its own instead.",
    )
    view.add_argument("result", metavar="RESULT", type=Path, help="folder written by `vsr2 run`")
    view.add_argument("--trial", type=int, help="index (default: the first that has a log)")
    view.add_argument("--host", default="127.0.0.1", help="address to listen on (default: here)")
    view.add_argument("--port", type=int, default=8080, help="default: 8080, or the next free one")
    view.add_argument("--html", metavar="FILE", type=Path, help="write a self-contained page")
    view.set_defaults(run=_view)


def _view(options: argparse.Namespace) -> int:
    from vsr2.view import ReplayServer, write_page

    if options.html is not None:
        print(f"wrote {write_page(options.result, options.html, trial=options.trial)}")
        return 0
    with ReplayServer(
        options.result, trial=options.trial, host=options.host, port=options.port
    ) as server:
        print(f"replay at {server.url} (Ctrl-C ends it)", flush=True)
        try:
            server.wait()
        except KeyboardInterrupt:
            print()
    return 0
