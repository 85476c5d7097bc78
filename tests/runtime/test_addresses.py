from __future__ import annotations

from pathlib import Path

import pytest

from taxelflow.acquire.devices import stdin
from taxelflow.errors import AddressInvalid
from taxelflow.runtime.addresses import parse_address


def test_a_path_may_begin_at_the_home_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/hand")
    assert parse_address("tables:~/x").file_path("tables:DIR") == Path("/home/hand/x")
    assert parse_address("tables:x~/~").file_path("tables:DIR") == Path("x~/~")


def test_the_home_of_nobody_is_refused() -> None:
    with pytest.raises(AddressInvalid, match="no home directory is known for ~nobody-of-that-name; give tables:DIR"):
        parse_address("tables:~nobody-of-that-name/x").file_path("tables:DIR")


@pytest.mark.parametrize(
    ("url", "meant"),
    [
        ("mcap://runs/a.mcap", "mcap:runs/a.mcap"),
        ("mcap:///a.mcap", "mcap:/a.mcap"),
        ("mcap://a.mcap?draw=0", "mcap:a.mcap"),
    ],
)
def test_a_path_does_not_follow_two_slashes(url: str, meant: str) -> None:
    with pytest.raises(AddressInvalid, match=f"// is followed by a host, not by a path; give {meant}$"):
        parse_address(url).file_path("mcap:FILE")


def test_a_topic_follows_host_and_port() -> None:
    assert parse_address("rosbridge://a:1/touch").need_path("rosbridge://HOST:PORT/topic") == "touch"


def test_what_has_no_meaning_is_refused() -> None:
    with pytest.raises(AddressInvalid, match="the path 'scans' has no meaning here; give tcp://HOST:PORT"):
        _ = parse_address("tcp://127.0.0.1:5000/scans").endpoint
    with pytest.raises(AddressInvalid, match=r"the path 'log\.csv' has no meaning here"):
        stdin.read(parse_address("stdin:log.csv"), None)
    with pytest.raises(AddressInvalid, match="the host 'hand' has no meaning here; give inspire-dds:"):
        parse_address("inspire-dds://hand").refuse_path("inspire-dds:?side=r")
