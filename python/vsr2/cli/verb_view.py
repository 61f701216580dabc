"""`vsr2 view`: a trial as a 3-D replay in the browser."""

from __future__ import annotations

from pathlib import Path

from vsr2.cli.options import Integer, Overwrite, Quiet, target_file


def view(
    result: Path,
    /,
    *,
    trial: Integer | None = None,
    host: str = "127.0.0.1",
    port: Integer = 8080,
    out: Path | None = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> int:
    """Replay a trial in 3-D in the browser.

    Serves an interactive 3-D replay of a result until Ctrl-C; open the printed address in a
    browser, on this machine or through a forwarded port. No screen is needed here. With --out,
    writes the replay of one trial as a page of its own instead.

    Args:
        result: folder written by `vsr2 run`
        trial: index (default: the first that has a log)
        host: address to listen on
        port: this one, or the next that is free
        out: write a self-contained page into this .html file
    """
    from vsr2.report.messages.commands import replay_at
    from vsr2.report.messages.written import wrote
    from vsr2.view import ReplayServer, write_page

    if out is not None:
        page = write_page(result, target_file(out, overwrite=overwrite), trial=trial)
        if not quiet:
            print(wrote(page))
        return 0
    with ReplayServer(result, trial=trial, host=host, port=port) as server:
        print(replay_at(server.url), flush=True)
        try:
            server.wait()
        except KeyboardInterrupt:
            print()
    return 0
