from __future__ import annotations

import socket

import pytest

from taxelflow.runtime.endpoints import authority, listening, place_of


@pytest.mark.parametrize(
    ("host", "port", "shown"),
    [("127.0.0.1", 5000, "127.0.0.1:5000"), ("::1", 5000, "[::1]:5000"), ("hand.local", None, "hand.local")],
)
def test_an_ipv6_address_stands_in_brackets(host: str, port: int | None, shown: str) -> None:
    assert authority(host, port) == shown


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_a_client_reaches_what_listens(host: str) -> None:
    with listening((host, 0)) as server, socket.create_connection((host, server.getsockname()[1])):
        assert place_of(server).rpartition(":")[0] in ("127.0.0.1", "[::1]")
