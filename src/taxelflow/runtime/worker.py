"""Processes that work for all live streams of this one, so that their threads do not wait for Python's lock.

It is started with a pipe to it and one from it, not by `multiprocessing`, which would import the user's script once
more. Its pipe ends when this process ends, however that happens, and so does it.
"""

from __future__ import annotations

import atexit
import logging
import os
import pickle
import signal
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from typing import IO, TYPE_CHECKING, Any, Protocol, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable

    Result = TypeVar("Result")

_END_S = 5.0
"""Time for a worker process to end by itself."""
_log = logging.getLogger("taxelflow")


class Runs(Protocol):
    """Runs functions beside the caller, such as `concurrent.futures.ThreadPoolExecutor`."""

    def submit(self, function: Callable[..., Result], /, *arguments: Any) -> Future[Result]:
        """Run it when there is time."""
        ...


class Worker:
    """Runs functions of modules one after the other, in a process of its own if one can be started."""

    def __init__(self) -> None:
        self._order = ThreadPoolExecutor(1, thread_name_prefix="taxelflow-worker")
        self._process: subprocess.Popen[bytes] | None = None
        try:
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
            )
        except OSError as error:
            self._lost(error)

    def submit(self, function: Callable[..., Result], /, *arguments: Any) -> Future[Result]:
        """Run it when what was submitted before is done."""
        return self._order.submit(self._call, function, arguments)

    def close(self) -> None:
        """End the process."""
        self._order.shutdown(wait=True, cancel_futures=True)
        process, self._process = self._process, None
        if process is not None:
            _end(process)

    def _call(self, function: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            return _copied(function, arguments)
        try:
            pickle.dump((function, arguments), process.stdin, pickle.HIGHEST_PROTOCOL)
            process.stdin.flush()
            result, error = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as lost:
            self._lost(lost)
            return _copied(function, arguments)
        if error is not None:
            raise error
        return cast("Result", result)

    def _lost(self, error: Exception) -> None:
        """Go on without the process."""
        _log.warning("the process that learns beside the stream is lost; a thread learns instead (%s)", error)
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Close its pipes, whereupon it ends."""
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # what could not be written
            if pipe is not None:
                pipe.close()
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _copied(function: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
    """The same call here, on copies as the process would get: of the same memory layout, with the same results."""
    return function(*pickle.loads(pickle.dumps(arguments, pickle.HIGHEST_PROTOCOL)))


@cache
def worker(kind: str = "learns") -> Worker:
    """That of this process and kind, started when it is first asked for. What is urgent has a kind of its own."""
    made = Worker()
    atexit.register(made.close)
    return made


def serve(requests: IO[bytes], results: IO[bytes]) -> None:
    """Answer requests until there are no more."""
    while True:
        try:
            function, arguments = pickle.load(requests)
        except (EOFError, pickle.UnpicklingError):  # the latter where it was killed in the middle of a request
            return
        answer: tuple[object, Exception | None]
        try:
            answer = function(*arguments), None
        except Exception as error:
            answer = None, error
        try:
            pickle.dump(answer, results, pickle.HIGHEST_PROTOCOL)
            results.flush()
        except BrokenPipeError:  # nobody waits any more
            return


def _main() -> None:
    """The process: the one that it works for ends it, so that it outlives a signal to both."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed must not stand among the results
    if hasattr(os, "nice"):
        os.nice(5)  # the scans come first
    serve(sys.stdin.buffer, results)


if __name__ == "__main__":
    _main()
