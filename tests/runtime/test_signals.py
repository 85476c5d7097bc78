"""A signal ends a run in order, whenever it comes."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest

from streaming import free_port
from taxelflow.acquire.devices.base import Backoff
from taxelflow.cli import main
from taxelflow.runtime.signals import EndedEarly, Signals

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_before_the_source_is_open_a_signal_breaks_off(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(EndedEarly), Signals():
        signal.raise_signal(number)
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_afterwards_a_signal_asks_for_the_end(number: signal.Signals) -> None:
    with Signals() as signals, signals:  # the command enters it, and so does the run
        signals.begin()
        signal.raise_signal(number)
        assert signals.asked.is_set()


def test_a_second_interrupt_interrupts_and_a_run_that_ends_by_itself_waits_for_two() -> None:
    with Signals() as signals:
        signals.begin()
        signals.asked.set()  # as at the end of --duration
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_a_signal_whose_exception_was_lost_ends_the_run_before_it_begins() -> None:
    with Signals() as signals:
        with pytest.raises(EndedEarly):
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(EndedEarly):
            signals.begin()


@pytest.mark.parametrize("command", ["run", "record"])
def test_a_run_that_waits_for_its_device_ends_by_sigterm_and_touches_no_file(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Backoff, "pause", lambda _self: iter([signal.raise_signal(signal.SIGTERM)]))
    out = tmp_path / "a.mcap"
    out.write_text("an older run")
    words = ["--to", f"mcap:{out}"] if command == "run" else [str(out)]
    url = f"tcp://127.0.0.1:{free_port()}?wait=60"
    assert main([command, url, *words, "--sensor", "grid:4x4@10mm", "--quiet"]) == 0
    assert capsys.readouterr().err.splitlines()[-1] == "taxelflow: ended before the source was open"
    assert out.read_text() == "an older run"
