"""The server of JSON lines, and clients of every kind."""

from __future__ import annotations

import socket
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from streaming import PALM, free_port, slid
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.loop import update_of
from taxelflow.publish.sinks import jsonl
from taxelflow.publish.sinks.base import Ending, Head
from taxelflow.publish.sinks.jsonl import JsonServer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.publish.sinks.base import Update


class Server:
    """A server that is open, and what it has reported."""

    def __init__(self) -> None:
        self.port, self.said = free_port(), list[str]()
        self.sink = JsonServer(("127.0.0.1", self.port))
        self.sink.open(Head(PALM, ("pad0",), {}, lambda kind, seen: self.said.append(f"{kind}: {seen}")))

    def client(self) -> socket.socket:
        connected = socket.create_connection(("127.0.0.1", self.port), timeout=5)
        self.sink.tick()
        return connected


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.sink.close(Ending(None, ()))


@pytest.fixture(scope="module")
def update() -> Update:
    live, scans = Live(PALM), slid(30)
    outputs = [live.step(t_s, values) for t_s, values in zip(scans.t_s.tolist(), scans.values, strict=True)]
    live.finish()
    return update_of(outputs[-1], np.zeros(1))


def test_more_clients_than_there_is_room_for_are_refused_and_others_go_on(
    server: Server, update: Update, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jsonl, "_CLIENTS", replace(jsonl._CLIENTS, most=2))
    with server.client() as first, server.client() as second, server.client() as third:
        server.sink.write(update)
        assert third.recv(10) == b""
        assert first.recv(10) == second.recv(10) == b'{"t_s":0.3'
        assert server.said == ["a client is refused: 2 are connected"]


def test_a_client_that_leaves_makes_room(server: Server, update: Update, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jsonl, "_CLIENTS", replace(jsonl._CLIENTS, most=1))
    server.client().close()
    for _ in range(3):  # the first line is sent before the system knows
        server.sink.write(update)
    with server.client() as second:
        server.sink.write(update)
        assert second.recv(10) == b'{"t_s":0.3'


def test_a_system_without_files_to_spare_costs_that_client_only(
    server: Server, update: Update, monkeypatch: pytest.MonkeyPatch
) -> None:
    with server.client() as first:
        accept = socket.socket.accept

        def fails(_server: socket.socket) -> None:
            raise OSError(24, "Too many open files")

        monkeypatch.setattr(socket.socket, "accept", fails)
        server.sink.write(update)
        monkeypatch.setattr(socket.socket, "accept", accept)
        assert first.recv(10) == b'{"t_s":0.3'


def test_a_client_that_sends_no_more_still_reads(server: Server, update: Update) -> None:
    with server.client() as client:
        client.shutdown(socket.SHUT_WR)
        server.sink.write(update)
        assert client.recv(10) == b'{"t_s":0.3'
