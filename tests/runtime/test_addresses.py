from __future__ import annotations

from pathlib import Path

import pytest

from taxelflow.errors import AddressInvalid
from taxelflow.runtime.addresses import parse_address


def test_a_path_may_begin_at_the_home_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/hand")
    assert parse_address("tables:~/x").file_path("tables:DIR") == Path("/home/hand/x")
    assert parse_address("tables:x~/~").file_path("tables:DIR") == Path("x~/~")


def test_the_home_of_nobody_is_refused() -> None:
    with pytest.raises(AddressInvalid, match="no home directory is known for ~nobody-of-that-name; give tables:DIR"):
        parse_address("tables:~nobody-of-that-name/x").file_path("tables:DIR")
