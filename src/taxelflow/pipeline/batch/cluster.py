"""Tasks on Dask: workers of this machine or a scheduler's, few tasks under way at once, lost ones submitted again."""

from __future__ import annotations

import logging
import signal
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from hashlib import blake2b
from itertools import islice
from multiprocessing import resource_tracker
from pickle import dumps
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from taxelflow.errors import ClusterFault, ExtraMissing
from taxelflow.pipeline.batch.task import Outcome, Settings, estimate_one
from taxelflow.runtime.signals import EndedEarly, Signals

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class _Patience:
    """With a scheduler and its workers."""

    per_worker: int = 2
    """Tasks submitted at once for each thread of a worker: one runs, one waits. More would fill the scheduler's
    memory."""
    answer_s: int = 10
    workers_s: int = 60
    """How long a scheduler may take to answer, and to have a worker, s."""
    look_s: float = 2.0
    """Interval at which the client looks whether scheduler and workers are there, s."""
    attempts: int = 2
    """How often a task is submitted that lost its worker more often than the scheduler allows."""


_PATIENCE = _Patience()

_QUIET = {
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.worker.profile.enabled": False,
}
"""Settings of Dask on this machine: by default client and workers monitor themselves up to 50 times a second, which
costs each some 5 % of a core, and nothing uses it."""
_LOGS = ("distributed", "distributed.client", "tornado.application", "asyncio")
"""Loggers of faults, each of which becomes one line of ours."""
_ENCRYPTED = ("tls", "wss")
"""Schemes whose clients need a certificate."""
_AGAIN = "what is finished is kept: run the same command again"


@contextmanager
def connected(scheduler: str | None, workers: int | None, *, most: int) -> Iterator[Any]:
    """A Dask client of the scheduler at this address, or of `workers` processes of this machine, at most `most`.

    Raises ExtraMissing, ClusterFault.
    """
    try:
        import dask
        from dask.system import CPU_COUNT
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ExtraMissing("cluster", "distributed") from error
    for name in _LOGS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    if scheduler is not None:
        with _joined(scheduler) as client:
            yield client
        return
    with (
        dask.config.set(_QUIET),
        _started(
            lambda: LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=min(workers or CPU_COUNT, most),
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",  # a free port
                memory_limit=None,  # a recording is read in blocks; a worker that is stopped by a guess loses its task
                silence_logs=logging.CRITICAL,
            )
        ) as cluster,
        Client(cluster, set_as_default=False) as client,  # type: ignore[no-untyped-call]
    ):
        yield client


@contextmanager
def _started(start: Callable[[], Any]) -> Iterator[Any]:
    """A cluster of this machine. Raises EndedEarly, ClusterFault.

    A signal counts once it has started: Dask leaves a traceback of one that is broken off. Its processes do not hear
    the Ctrl-C of a terminal, which would make each print one; this process ends them.
    """
    with Signals() as signals:
        signals.begin()
        resource_tracker.ensure_running()  # where it starts, it lets the signal through again
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # threads and processes inherit it
        try:
            cluster = start()
        except RuntimeError as error:
            if signals.asked.is_set():
                raise EndedEarly from error
            raise ClusterFault(f"workers of this machine do not start: {error}", _AGAIN) from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)
    with cluster:
        if signals.asked.is_set():
            raise EndedEarly
        yield cluster


@contextmanager
def _joined(scheduler: str) -> Iterator[Any]:
    """A client of the scheduler at this address, once it has workers. Raises ClusterFault."""
    from distributed import Client
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.comm.registry import get_backend
    from distributed.security import Security

    try:
        scheme, place = parse_address(scheduler)  # a client of what is no address ends with a traceback
        parse_host_port(place)
        get_backend(scheme).get_connector()  # type: ignore[no-untyped-call]
        secured = Security().get_connection_args("client")  # type: ignore[no-untyped-call]
        if scheme in _ENCRYPTED and not secured.get("ssl_context"):
            remedy = "set ca-file, key and cert under distributed.comm.tls in Dask's configuration"
            raise ClusterFault(f"Dask has no certificates for {scheduler}", remedy)
        client = Client(scheduler, timeout=_PATIENCE.answer_s, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, TypeError, ValueError, TimeoutError) as error:
        remedy = "start one with `dask scheduler` and give its address, such as tcp://HOST:8786"
        raise ClusterFault(f"no scheduler answers at {scheduler}: {error}", remedy) from error
    try:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE.workers_s)
        except TimeoutError as error:
            remedy = f"start some with `dask worker {scheduler} --nthreads 1`"
            raise ClusterFault(f"the scheduler at {scheduler} has no workers", remedy) from error
        yield client
    finally:
        with suppress(Exception):  # a scheduler that is gone cannot take leave
            client.close()  # type: ignore[no-untyped-call]


def outcomes(client: Any, settings: Settings, tasks: Iterable[tuple[Path, Path]]) -> Iterator[tuple[Path, Outcome]]:
    """Recordings and what became of them, in the order in which they end.

    tasks: each recording with the directory of its results. A task that is lost with its worker runs again. Raises
    ClusterFault when the scheduler is lost, or all workers.
    """
    ended: SimpleQueue[Any] = SimpleQueue()
    under_way: dict[str, tuple[Path, Path, int, Any]] = {}
    known = dumps(settings)
    waiting = iter(tasks)

    def submit(source: Path, out: Path, attempt: int = 1) -> None:
        """Its key is the task's: a second client that asks for it meets the one that runs."""
        named = f"{known!r} {source} {out} {attempt}".encode(errors="surrogateescape")
        key = f"estimate-{blake2b(named, digest_size=16).hexdigest()}"
        future = client.submit(estimate_one, settings, str(source), str(out), key=key, pure=True)
        under_way[key] = (source, out, attempt, future)
        future.add_done_callback(ended.put)

    def fill() -> None:
        room = _PATIENCE.per_worker * max(1, sum(client.nthreads().values())) - len(under_way)
        for source, out in islice(waiting, max(0, room)):
            submit(source, out)

    fill()
    while under_way:
        future = _next(client, ended)
        source, out, attempt, _ = under_way.pop(future.key)
        outcome = _outcome(client, future)
        if outcome is None and attempt < _PATIENCE.attempts:
            submit(source, out, attempt + 1)
        else:
            yield source, outcome or Outcome("fault", message=f"its workers died while they estimated {source}")
        fill()


def _next(client: Any, ended: SimpleQueue[Any]) -> Any:
    """The next future that ends. Raises ClusterFault when none can."""
    alone_s = 0.0
    while True:
        try:
            return ended.get(timeout=_PATIENCE.look_s)
        except Empty:
            workers = _workers(client)
        alone_s = 0.0 if workers else alone_s + _PATIENCE.look_s
        if alone_s >= _PATIENCE.workers_s:
            raise ClusterFault(f"all workers were lost, and none came back within {_PATIENCE.workers_s} s", _AGAIN)


def _workers(client: Any) -> int:
    """Number of workers. Raises ClusterFault when the scheduler is lost."""
    if client.status == "running":
        with suppress(Exception):
            return len(client.nthreads())
    raise ClusterFault("the scheduler was lost", _AGAIN)


def _outcome(client: Any, future: Any) -> Outcome | None:
    """What the task returned; None if its workers died. Raises ClusterFault when the scheduler is lost."""
    from distributed import KilledWorker

    try:
        outcome: Outcome = future.result(timeout=_PATIENCE.workers_s)
    except KilledWorker:
        return None
    except Exception as error:
        _workers(client)
        return Outcome("fault", message=f"a worker could not run the task: {type(error).__name__}: {error}")
    return outcome
