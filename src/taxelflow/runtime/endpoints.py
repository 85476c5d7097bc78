"""Hosts and ports at which a source or sink listens, by IPv4 or IPv6."""

from __future__ import annotations

import socket


def authority(host: str, port: int | None) -> str:
    """HOST:PORT as a URL has it, with an IPv6 address in brackets."""
    shown = f"[{host}]" if ":" in host else host
    return shown if port is None else f"{shown}:{port}"


def family_of(host: str) -> socket.AddressFamily:
    """The family of a host's address: IPv6 where it is written with colons."""
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def listening(endpoint: tuple[str, int], backlog: int | None = None) -> socket.socket:
    """A socket that listens at host and port. Raises OSError."""
    return socket.create_server(endpoint, family=family_of(endpoint[0]), backlog=backlog)


def place_of(server: socket.socket) -> str:
    """Where a socket listens, as a URL has it."""
    return authority(*server.getsockname()[:2])
