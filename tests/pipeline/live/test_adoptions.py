"""A live loop never waits for what is learned beside it, and its results come out once more by the log of it."""

from __future__ import annotations

import itertools
import json
import os
import threading
from concurrent.futures import Future
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from streaming import PALM, opened, published, slid
from taxelflow.acquire.base import Recording
from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.metadata import texts_of
from taxelflow.cli import main
from taxelflow.condition import relearning
from taxelflow.condition.sample import WINDOWS
from taxelflow.errors import AddressInvalid
from taxelflow.estimation.template.online import session
from taxelflow.messages import Output, cut, joined
from taxelflow.pipeline.live import intake
from taxelflow.pipeline.live.adoptions import asked_adoptions, asked_missed
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.command import opened_sinks
from taxelflow.pipeline.live.loop import Limits, run_live, update_of
from taxelflow.pipeline.live.mcap_sink import McapSink
from taxelflow.pipeline.live.replay import Replay
from taxelflow.publish.sinks.base import Ending, Head
from taxelflow.publish.sinks.lines import json_lines
from taxelflow.runtime.addresses import parse_address
from taxelflow.runtime.adoption import Adoption, AsRecorded, Lane, Late, WhenReady
from taxelflow.runtime.worker import Worker

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from taxelflow.acquire.devices.base import Arrival
    from taxelflow.messages import RawScans


class Stalled:
    """Runs what is needed at the start, then nothing until it is told to."""

    def __init__(self) -> None:
        self.stalls = False
        self.waiting: list[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = []

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        result: Future[Any] = Future()
        if self.stalls:
            self.waiting.append((result, function, arguments))
        else:
            result.set_result(function(*arguments))
        return result

    def go_on(self) -> None:
        for result, function, arguments in self.waiting:
            if result.set_running_or_notify_cancel():
                result.set_result(function(*arguments))
        self.waiting = []

    def shutdown(self) -> None:
        pass


def _with_workers(beside: Stalled, patched: pytest.MonkeyPatch, method: str = "template") -> Live:
    """A loop whose mapper is beside, and whose first maps are there at once."""
    with patched.context() as making:
        making.setattr(session, "worker", lambda kind="learns": beside if kind == "learns" else Stalled())
        return Live(PALM, method)


def steps(live: Live, begin: int, end: int) -> Output:
    scans = slid()
    return joined([live.step(float(scans.t_s[k]), scans.values[k]) for k in range(begin, end)])


def test_a_loop_goes_on_while_nothing_is_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    beside = Stalled()
    live = _with_workers(beside, monkeypatch)
    beside.stalls = True
    steps(live, 0, 40)
    mapped = [adoption for adoption in _maps_of(live) if adoption.number > 0]
    asked = [result for result, *_ in beside.waiting if not result.cancelled()]  # others were asked for again
    assert (mapped, len(asked)) == ([], 1)
    steps(live, 40, 50)
    beside.go_on()
    out = steps(live, 50, 60)
    assert np.isfinite(out.slips.pose[:, 0, :2]).all()
    assert _maps_of(live)[-1].t_s == float(slid().t_s[50])


def _maps_of(live: Live) -> list[Adoption]:
    """Adopted maps, without the tare: that has a thread of its own."""
    return [adoption for adoption in live.adopted() if adoption.what == "pad0"]


@pytest.mark.long
@pytest.mark.parametrize(("method", "lag"), [("template", 7), ("convolution", 31)])
def test_a_replay_gives_what_the_loop_gave(
    method: str, lag: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside = Stalled()
    monkeypatch.setattr(relearning, "worker", lambda: beside)
    live, device = _with_workers(beside, monkeypatch, method), Replay(_recorded(), speed=0.0)
    _lagging(live, beside, monkeypatch, lag)
    _logged(device, live, tmp_path)
    adoptions = _replayed(tmp_path, method)
    assert len(adoptions) > 1
    one, other = _lines(tmp_path, "a"), _lines(tmp_path, "b")
    assert len(one) == len(slid())
    assert one == other
    run_live(
        _device(tmp_path), opened_sinks((f"jsonl:{tmp_path / 'c.jsonl'}",)), Live(PALM, method, adoptions=[]), Limits()
    )
    assert _lines(tmp_path, "c") != one  # when it was used is what makes the difference


@pytest.mark.long
def test_a_replay_leaves_out_scans_that_the_loop_had_no_time_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(intake, "_INTAKE", replace(intake._INTAKE, waiting=30))
    live, device = Live(PALM), _Impatient(_recorded(), speed=0.0)
    push = live.push

    def push_when_all_has_come(scans: RawScans) -> Output:
        device.has_ended.wait(20)
        return push(scans)

    monkeypatch.setattr(live, "push", push_when_all_has_come)
    _logged(device, live, tmp_path)
    _replayed(tmp_path, "convolution")
    one, other = _lines(tmp_path, "a"), _lines(tmp_path, "b")
    assert 30 <= len(one) <= 60
    assert one == other
    assert asked_missed(parse_address(f"replay:{tmp_path / 'a.mcap'}")) == frozenset()


def test_scans_that_have_waited_are_estimated_in_one_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    live, device, sizes = Live(PALM, adoptions=[]), _Impatient(_recorded(), speed=0.0), []
    push = live.push

    def push_when_all_has_come(scans: RawScans) -> Output:
        device.has_ended.wait(20)
        sizes.append(len(scans))
        return push(scans)

    monkeypatch.setattr(live, "push", push_when_all_has_come)
    report = run_live(device, opened_sinks((f"jsonl:{tmp_path / 'a.jsonl'}",)), live, Limits())
    assert sum(sizes) == len(slid())
    assert max(sizes) == intake._INTAKE.taken
    alone = Live(PALM, adoptions=[])
    steps = [alone.push(cut(slid(), scan, scan + 1)) for scan in range(len(slid()))]
    update = update_of(joined([*steps, alone.finish()]))
    assert _lines(tmp_path, "a") == [json.loads(line) | {"age_ms": 0} for line in json_lines(update, live.pads)]
    assert len(slid()) - WINDOWS.scans <= len(report.estimated) <= len(slid())


class _Impatient(Replay):
    """A device that does not wait for its reader."""

    patient = False

    def __init__(self, recording: Recording, speed: float) -> None:
        super().__init__(recording, speed)
        self.has_ended = threading.Event()

    def __iter__(self) -> Iterator[Arrival | None]:
        yield from super().__iter__()
        self.has_ended.set()


def _logged(device: Replay, live: Live, folder: Path) -> None:
    sinks = f"mcap:{folder / 'a.mcap'}?draw=0", f"jsonl:{folder / 'a.jsonl'}"
    run_live(device, opened_sinks(sinks), live, Limits())


def _device(folder: Path, asked: str = "ready") -> Any:
    return opened(f"replay:{folder / 'a.mcap'}?speed=max&adoptions={asked}")


def _replayed(folder: Path, method: str) -> list[Adoption]:
    """Run once more by the log; its adoptions."""
    adoptions = asked_adoptions(f"replay:{folder / 'a.mcap'}?speed=max&adoptions=recorded")
    assert adoptions is not None
    again = Live(PALM, method, adoptions=adoptions)
    run_live(_device(folder, "recorded"), opened_sinks((f"jsonl:{folder / 'b.jsonl'}",)), again, Limits())
    return adoptions


def _lines(folder: Path, name: str) -> list[dict[str, Any]]:
    return [line | {"age_ms": 0} for line in published(folder / f"{name}.jsonl")]


def _lagging(live: Live, beside: Stalled, patched: pytest.MonkeyPatch, lag: int) -> None:
    """What is learned comes up to so many scans late, the same on every machine."""
    push, pushed = live.push, itertools.count(1)

    def push_each(scans: RawScans) -> Output:
        return joined([push_then_learn(cut(scans, scan, scan + 1)) for scan in range(len(scans))])

    def push_then_learn(scans: RawScans) -> Output:
        number = next(pushed)
        beside.stalls = number < len(slid())
        if number % lag == 0 or not beside.stalls:
            beside.go_on()
        return push(scans)

    patched.setattr(live, "push", push_each)


def _recorded() -> Recording:
    return Recording("slid", "memory", PALM, lambda: iter([slid()]), scans=len(slid()))


def test_only_the_file_of_a_run_holds_adoptions(tmp_path: Path) -> None:
    assert asked_adoptions("rig:stroke?adoptions=recorded") is None
    assert asked_adoptions(f"replay:{tmp_path / 'a.mcap'}") is None
    with pytest.raises(AddressInvalid, match="holds no adoptions"):
        asked_adoptions(f"replay:{tmp_path / 'a.npz'}?adoptions=recorded")
    assert main(["record", "rig:stroke?speed=max", str(tmp_path / "a.mcap"), "--max-scans", "20", "--quiet"]) == 0
    with pytest.raises(AddressInvalid, match="holds no adoptions"):
        asked_adoptions(f"replay:{tmp_path / 'a.mcap'}?adoptions=recorded")


def test_the_adoptions_of_a_killed_run_are_used(tmp_path: Path) -> None:
    adoptions, file = [Adoption("pad0", 0, 0.1), Adoption("pad0", 1, 0.2)], tmp_path / "a.mcap"
    sink = McapSink(file, drawn=False)
    sink.open(Head(PALM, ("pad0",), texts_of(_recorded()), Faults().report))
    sink.write(update_of(steps(Live(PALM), 0, 20), None, adoptions, missed=[0.3]))
    sink.close(Ending(None, ()))
    file.write_bytes(file.read_bytes()[:-20])
    url = f"replay:{file}?adoptions=recorded"
    assert asked_adoptions(url) == adoptions
    assert asked_missed(parse_address(url)) == {0.3}


def test_a_lane_uses_one_thing_at_a_time() -> None:
    ready, used = WhenReady(), []
    lane, first, second = Lane("pad", ready), Future[int](), Future[int]()
    lane.begin(first, 1.0, 1.1, used.append)
    assert lane.due_s == np.inf
    lane.begin(second, 2.0, 2.1, used.append)
    second.set_result(7)
    assert first.cancelled()
    assert lane.due_s == -np.inf
    lane.adopt(3.0)
    assert (used, lane.busy, lane.due_s) == ([7], False, np.inf)
    assert ready.taken() == [Adoption("pad", 1, 3.0)]
    assert ready.taken() == []


def test_what_was_recorded_is_used_then_and_what_was_not_never() -> None:
    lane = Lane("pad", AsRecorded([Adoption("pad", 1, 5.0)]))
    for number, due_s in enumerate((np.inf, 5.0, np.inf)):
        lane.begin(Future(), float(number), 0.0, print)
        assert lane.due_s == due_s
    late = Lane("pad", Late(0.5))
    for planned_s, due_s in ((1.1, 1.5), (1.0, 1.0)):  # what is planned at once comes at once
        late.begin(Future(), 1.0, planned_s, print)
        assert late.due_s == due_s


def test_a_worker_that_is_lost_is_replaced_by_a_thread(caplog: pytest.LogCaptureFixture) -> None:
    worker = Worker()
    try:
        assert worker.submit(os.getpid).result(60) != os.getpid()
        with pytest.raises(FileNotFoundError):
            worker.submit(os.stat, "/nowhere").result(60)
        process = worker._process
        assert process is not None
        process.kill()
        assert worker.submit(os.getpid).result(60) == os.getpid()
        assert "learns beside the stream is lost" in caplog.text
    finally:
        worker.close()
