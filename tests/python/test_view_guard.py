"""The 3-D view answers its own page alone: no other site's page can read or steer it."""

from __future__ import annotations

import http.client
import urllib.parse
from collections.abc import Iterator

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from synthetic_results import falling_log, make_result
from vsr2.results import save_models, save_result
from vsr2.scene import Box
from vsr2.scene.shapes import box_surface
from vsr2.view import ReplayServer
from vsr2.view.guard import is_own_request


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ReplayServer]:
    folder = tmp_path_factory.mktemp("view") / "result"
    save_result(make_result([falling_log()]), folder)
    save_models(folder, box_surface(Box((0.5, 0.5, 1.0))), box_surface(Box((4.0, 4.0, 0.5))))
    with ReplayServer(folder) as one:
        yield one


def get(server: ReplayServer, host: str, **headers: str) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    connection.request("GET", "/", headers={"Host": host, **headers})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    if answer.status == 403:
        assert b"open the address that `vsr2 view` printed" in body
    return answer.status


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "[::1]"])
def test_the_page_is_served_under_names_of_this_machine(server: ReplayServer, name: str) -> None:
    assert get(server, f"{name}:{server.port}") == 200


def test_a_foreign_host_is_refused(server: ReplayServer) -> None:
    # As a browser asks whose name server lets the name point here.
    assert get(server, f"attacker.example:{server.port}") == 403
    assert get(server, "192.0.2.7") == 403


def test_a_foreign_origin_is_refused(server: ReplayServer) -> None:
    own = f"127.0.0.1:{server.port}"
    assert get(server, own, Origin=f"http://{own}") == 200
    assert get(server, own, Origin="http://attacker.example") == 403


def websocket(server: ReplayServer, origin: str | None) -> None:
    client = urllib.parse.urlsplit(server.url)
    with connect(f"ws://{client.netloc}", origin=origin, subprotocols=["viser-v0"]):
        pass


def test_a_websocket_of_another_pages_is_refused(server: ReplayServer) -> None:
    websocket(server, server.url)
    for origin in ("http://attacker.example", "null", f"http://localhost:{server.port}"):
        with pytest.raises(InvalidStatus) as refused:
            websocket(server, origin)
        assert refused.value.response.status_code == 403


@pytest.mark.parametrize(
    ("host", "origin", "listening", "own"),
    [
        ("localhost:9000", None, "127.0.0.1", True),  # a forwarded port
        ("localhost:9000", "http://localhost:9000", "127.0.0.1", True),
        ("localhost:9000", "http://localhost:9001", "127.0.0.1", False),
        ("localhost", "https://localhost", "127.0.0.1", True),
        ("localhost", "file://localhost", "127.0.0.1", False),
        (None, None, "127.0.0.1", False),
        ("", None, "127.0.0.1", False),
        ("[", None, "127.0.0.1", False),
        ("10.0.0.7:8080", None, "127.0.0.1", False),
        ("10.0.0.7:8080", None, "0.0.0.0", True),
        ("attacker.example", None, "0.0.0.0", False),
        ("attacker.example", None, "", False),
        ("rock.local:8080", "http://rock.local:8080", "rock.local", True),
        ("localhost.attacker.example", None, "127.0.0.1", False),
        ("localhost@attacker.example", None, "127.0.0.1", False),
        ("localhost", "http://[", "127.0.0.1", False),
    ],
)
def test_own_requests(host: str | None, origin: str | None, listening: str, own: bool) -> None:
    assert is_own_request(host, origin, listening) is own
