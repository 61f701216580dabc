"""Keeps pages of other sites away from the 3-D view.

A page in the user's browser can reach servers of this machine: directly by a WebSocket, which the
same-origin rule does not stop, or under a name of its own that it lets point to 127.0.0.1. The
browser tells both by the headers `Origin` and `Host`, which a page cannot choose.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from inspect import isawaitable
from typing import Any
from urllib.parse import urlsplit

REFUSAL = (
    "refused: the request comes from another page, or under a name that is not this server's; open "
    "the address that `vsr2 view` printed\n"
)


def is_own_request(host: str | None, origin: str | None, listening: str) -> bool:
    """Whether a request was made to this server under a name of its own, and by its own page.

    Args:
        host: header `Host`; None: missing.
        origin: header `Origin`; None: missing, as for a page that is opened by its address, and for
            programs that are no browsers.
        listening: host that the server listens on.
    """
    if host is None or not _is_own_name(_name(host), listening):
        return False
    if origin is None:
        return True
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()


def _name(host: str) -> str:
    """A header `Host` without its port; empty: not of that form."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _is_own_name(name: str, listening: str) -> bool:
    if name in ("localhost", listening.lower()):
        return bool(name)
    everywhere = listening in ("", "0.0.0.0", "::")
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return everywhere and name in (socket.gethostname().lower(), socket.getfqdn().lower())
    # No page can make a bare address point elsewhere.
    return everywhere or address.is_loopback


@contextmanager
def own_requests_only(listening: str) -> Iterator[None]:
    """Servers of `websockets` that are started meanwhile answer their own requests alone.

    viser, which starts one, takes no check of its users.

    Args:
        listening: host that the server listens on.
    """
    import websockets.asyncio.server as module

    serve = module.serve

    def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        async def check(connection: Any, request: Any) -> Any:
            # Headers given twice are no browser's.
            hosts, origins = (request.headers.get_all(key) for key in ("Host", "Origin"))
            host = hosts[0] if len(hosts) == 1 else None
            origin = origins[0] if origins else None
            if len(origins) > 1 or not is_own_request(host, origin, listening):
                return connection.respond(HTTPStatus.FORBIDDEN, REFUSAL)
            answer = None if process_request is None else process_request(connection, request)
            return await answer if isawaitable(answer) else answer

        return serve(*arguments, process_request=check, **options)

    module.serve = guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        module.serve = serve  # type: ignore[misc]
