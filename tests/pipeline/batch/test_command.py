"""`taxelflow batch` in one process, in place of a cluster."""

from __future__ import annotations

import signal
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from batched import alone, manifest, one_by_one, slides, statuses, written
from rigged import refused
from taxelflow.cli import main
from taxelflow.errors import ClusterFault
from taxelflow.pipeline.batch import cluster
from taxelflow.pipeline.batch.task import Outcome, Settings
from taxelflow.runtime.signals import EndedEarly

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of two recordings and a broken one; batches run in this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("taxelflow.pipeline.batch.run.connected", alone)
    monkeypatch.setattr("taxelflow.pipeline.batch.run.outcomes", one_by_one)
    slides(tmp_path / "runs", "a.npz", "b.npz")
    (tmp_path / "runs" / "broken.npz").write_bytes(b"PK")
    return tmp_path / "runs"


def batch(*words: str) -> int:
    return main(["batch", "runs/*.npz", "--out", "out", *words])


def test_a_batch_does_what_is_missing_and_keeps_what_failed_until_asked(runs: Path, capsys: Capture) -> None:
    assert batch() == 1
    said = capsys.readouterr()
    assert said.out.startswith("3 recordings: 2 done (2 now, 0 before), 1 failed\n")
    assert "s of processor time per hour of recording" in said.out
    assert said.err.startswith(f"taxelflow: failed: {runs}/broken.npz: cannot read ")
    assert said.err.count("\n") == 1
    before = written(Path("out"))
    assert set(before) == {
        "batch.json",
        "manifest.csv",
        *(f"{name}/{file}" for name in "ab" for file in ("events.parquet", "object.parquet", "slips.parquet")),
        *(f"{name}/summary.json" for name in "ab"),
    }

    slides(runs, "broken.npz", "c.npz")
    assert batch() == 1
    said = capsys.readouterr()
    assert said.out.startswith("4 recordings: 3 done (1 now, 2 before), 1 failed\n")
    assert said.err.endswith("\ntaxelflow: 1 of these failed before and was left out; --retry-failed repeats it\n")
    after = written(Path("out"))
    assert {name: after[name] for name in before if name != "manifest.csv"} == {
        name: content for name, content in before.items() if name != "manifest.csv"
    }

    assert batch("--retry-failed") == 0
    assert capsys.readouterr().out.startswith("4 recordings: 4 done (1 now, 3 before), 0 failed\n")
    assert set(statuses(Path("out")).values()) == {"done"}
    assert all(float(row["seconds"]) > 0 for row in manifest(Path("out")))
    assert batch() == 0


@pytest.mark.usefixtures("runs")
def test_results_that_a_killed_client_has_not_noted_are_done(capsys: Capture) -> None:
    batch()
    lines = Path("out/manifest.csv").read_text().splitlines(keepends=True)
    kept = [line for line in lines if "/a.npz" not in line]
    Path("out/manifest.csv").write_text("".join(kept)[:-3])  # in the middle of the last row
    capsys.readouterr()
    assert batch() == 1
    assert "2 done (0 now, 2 before), 1 failed" in capsys.readouterr().out
    assert statuses(Path("out")) == {"a.npz": "done", "b.npz": "done", "broken.npz": "failed"}
    assert {row["recording"]: row["seconds"] for row in manifest(Path("out"))}["a.npz"] == ""


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_batch_in_order_and_keeps_what_is_finished(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture, number: signal.Signals
) -> None:
    def outcomes(
        client: None, settings: Settings, tasks: Iterable[tuple[Path, Path]]
    ) -> Iterator[tuple[Path, Outcome]]:
        yield next(one_by_one(client, settings, tasks))
        signal.raise_signal(number)

    monkeypatch.setattr("taxelflow.pipeline.batch.run.outcomes", outcomes)
    before = signal.getsignal(number)
    assert batch() == 130
    assert capsys.readouterr().err.endswith("interrupted; what is finished is kept: run the same command again\n")
    assert statuses(Path("out")) == {"a.npz": "done"}
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_cluster_that_a_signal_meets_at_its_start_is_closed(number: signal.Signals) -> None:
    seen = []

    @contextmanager
    def closing() -> Iterator[None]:
        seen.append("started")
        yield
        seen.append("not closed by an exception")

    def start() -> Any:
        signal.raise_signal(number)
        return closing()

    with pytest.raises(EndedEarly), cluster._started(start):
        seen.append("used")
    assert seen == ["started"]


def test_workers_that_do_not_start_are_a_fault_of_the_cluster_unless_a_signal_ended_them() -> None:
    def start(number: signal.Signals | None = None) -> Any:
        if number is not None:
            signal.raise_signal(number)
        raise RuntimeError("Nanny failed to start.")

    with pytest.raises(ClusterFault, match="do not start: Nanny failed"), cluster._started(start):
        pass
    with pytest.raises(EndedEarly), cluster._started(lambda: start(signal.SIGTERM)):
        pass


@pytest.mark.usefixtures("runs")
def test_a_recording_that_fails_again_was_not_done_before(capsys: Capture) -> None:
    batch()
    capsys.readouterr()
    assert batch("--retry-failed") == 1
    assert capsys.readouterr().out.startswith("3 recordings: 2 done (0 now, 2 before), 1 failed\n")


@pytest.mark.usefixtures("runs")
def test_a_recording_whose_table_was_removed_is_estimated_again(capsys: Capture) -> None:
    batch()
    before = written(Path("out"))
    Path("out/b/slips.parquet").unlink()
    capsys.readouterr()
    assert batch() == 1
    assert capsys.readouterr().out.startswith("3 recordings: 2 done (1 now, 1 before), 1 failed\n")
    assert written(Path("out")) == before


@pytest.mark.usefixtures("runs")
def test_other_settings_or_recordings_of_the_same_name_are_refused(capsys: Capture) -> None:
    assert batch() == 1
    words = ("batch", "runs/*.npz", "--out", "out")
    assert "out holds results with other settings: pipeline.estimator.gain was 1.0, is 1.1; use the same" in refused(
        capsys, *words, "--gain", "1.1"
    )
    assert "method was 'convolution', is 'lnorm'" in refused(capsys, *words, "--method", "lnorm")
    slides(Path("other"), "a.npz")
    Path("out/manifest.csv").unlink()
    assert "would both be in" in refused(capsys, "batch", "other/a.npz", "--out", "out")
    assert "would both be in" in refused(capsys, "batch", "other/a.npz", "runs/a.npz", "--out", "new")
    assert not Path("new").exists()


@pytest.mark.usefixtures("runs")
def test_another_sensor_is_named_in_a_short_line(capsys: Capture) -> None:
    batch()
    said = refused(capsys, "batch", "runs/*.npz", "--out", "out", "--sensor", "grid:4x4@5mm")
    assert "other settings: sensor was None, is 'grid:4x4@5mm'; use the same" in said
    assert len(said.partition(" holds ")[2]) < 120


def test_a_link_to_a_file_that_is_gone_is_a_failed_recording(runs: Path, capsys: Capture) -> None:
    (runs / "broken.npz").unlink()
    (runs / "broken.npz").symlink_to("gone.npz")
    assert batch() == 1
    assert capsys.readouterr().out.startswith("3 recordings: 2 done (2 now, 0 before), 1 failed\n")
    (row,) = (row for row in manifest(Path("out")) if row["status"] == "failed")
    assert row["message"].startswith(f"recording {runs}/broken.npz does not exist")
    assert batch() == 1  # it stays failed until asked
    slides(runs, "gone.npz")
    (runs / "broken.npz").unlink()
    (runs / "gone.npz").rename(runs / "broken.npz")
    assert batch("--retry-failed") == 0


@pytest.mark.usefixtures("runs")
def test_settings_may_change_while_nothing_is_done() -> None:
    Path("runs/plain.csv").write_text("t_s,a,b\n" + "".join(f"{scan / 10},1,{scan % 2}\n" for scan in range(30)))
    words = ["batch", "runs/plain.csv", "--out", "out"]
    assert main(words) == 1
    assert "--sensor" in manifest(Path("out"))[0]["message"]
    assert main([*words, "--sensor", "grid:1x2@4mm", "--retry-failed"]) == 0


@pytest.mark.usefixtures("runs")
def test_a_fault_of_a_worker_leaves_recordings_undone(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    def outcomes(
        client: None, settings: Settings, tasks: Iterable[tuple[Path, Path]]
    ) -> Iterator[tuple[Path, Outcome]]:
        first, *others = tasks
        yield first[0], Outcome("fault", message="OSError: No space left on device")
        yield from one_by_one(client, settings, others)

    monkeypatch.setattr("taxelflow.pipeline.batch.run.outcomes", outcomes)
    said = refused(capsys, "batch", "runs/*.npz", "--out", "out")
    assert "1 recording is not done, because workers failed" in said
    assert "a.npz: OSError: No space left on device; repair the cause, then run the same command again" in said
    assert statuses(Path("out")) == {"b.npz": "done", "broken.npz": "failed"}


@pytest.mark.usefixtures("runs")
def test_a_broken_cluster_ends_the_batch(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    def outcomes(
        _client: None, _settings: Settings, tasks: Iterable[tuple[Path, Path]]
    ) -> Iterator[tuple[Path, Outcome]]:
        [(first, _), *_] = tasks
        while True:
            yield first, Outcome("fault", message="a worker has taxelflow 0.0.9, not 0.1.0")

    monkeypatch.setattr("taxelflow.pipeline.batch.run.outcomes", outcomes)
    assert "3 recordings are not done" in refused(capsys, "batch", "runs/*.npz", "--out", "out")


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["runs/*.bag"], "recordings must match at least one recording (got 'runs/*.bag')"),
        ([], "recordings must name at least one path or a quoted pattern"),
        (["runs/*.npz", "--workers", "0"], "workers must be at least 1 (got 0)"),
        (
            ["runs/*.npz", "--workers", "1", "--scheduler", "tcp://127.0.0.1:1"],
            "workers must be left out with --scheduler",
        ),
        (
            ["runs/*.npz", "--scheduler", "tcp://127.0.0.1:99999"],
            "scheduler must have a port from 0 to 65535 (got 'tcp://127.0.0.1:99999')",
        ),
        (["runs/a.npz", "--gain", "1.1", "runs/b.npz"], "recordings must stand before the method's own options"),
        (["runs/*.npz", "--method", "tempalte"], "did you mean 'template'?"),
        (["runs/*.npz", "--sensor", "barret"], "unknown sensor 'barret'"),
    ],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_bad_input_is_refused_in_one_line(capsys: Capture, words: list[str], says: str) -> None:
    assert says in refused(capsys, "batch", *words, "--out", "out")
    assert not Path("out").exists()


def test_without_the_extra_the_message_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    [slide] = slides(tmp_path / "runs", "a.npz")
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert "pip install 'taxelflow[cluster]'" in refused(capsys, "batch", slide, "--out", tmp_path / "out")


def test_a_scheduler_that_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    [slide] = slides(tmp_path / "runs", "a.npz")
    monkeypatch.setattr(cluster, "_PATIENCE", replace(cluster._PATIENCE, answer_s=0.1))
    words = ("batch", slide, "--out", tmp_path / "out", "--scheduler")
    assert "no scheduler answers at tcp://127.0.0.1:1" in refused(capsys, *words, "tcp://127.0.0.1:1")
    monkeypatch.setattr("distributed.Client", None)  # one without an address prints a traceback when it goes
    for address in ("nowhere://x:1", "nowhere", "ucx://127.0.0.1:1"):
        assert f"no scheduler answers at {address}: " in refused(capsys, *words, address)
    assert "Dask has no certificates for tls://127.0.0.1:1; set ca-file" in refused(capsys, *words, "tls://127.0.0.1:1")


def test_help_of_a_method_shows_its_own_options(capsys: Capture) -> None:
    with pytest.raises(SystemExit):
        main(["batch", "--method", "template", "--help"])
    said = capsys.readouterr().out
    assert "--retry-failed" in said
    assert "--window-scans" in said
