"""What the command line reports of an exception, one line on standard error and the exit code; and output whose reader
leaves before its end.
"""

from __future__ import annotations

import errno
import os
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid, TaxelflowError, written_at
from taxelflow.runtime import registry
from taxelflow.runtime.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

OUTPUT = "standard output"
_REMEDIES = {errno.ENOSPC: "make room there", errno.EEXIST: "a file is in the way of a directory: give another one"}


@contextmanager
def as_far_as_read() -> Iterator[None]:
    """Print results to a reader that may leave before their end: notes and exit code, which follow, do not depend on
    it.
    """
    try:
        yield
        with written_at(OUTPUT):
            sys.stdout.flush()
    except (OSError, SystemExit) as error:
        if not _has_left(error):
            raise
        _drop_output()


def complain(error: BaseException, args: Sequence[str]) -> int:
    """Print what went wrong with a command of these words; its exit code. Raises what nobody foresaw."""
    if _has_left(error):
        _drop_output()
        return 0
    if isinstance(error, KeyboardInterrupt):
        _say("interrupted; rows computed so far stand in the .part files")
        return ExitCode.INTERRUPTED
    if isinstance(error, TaxelflowError):
        _say(error.on_command_line(list(args)) if isinstance(error, ParameterInvalid) else error)
    elif failed := registry.failed(error, args):
        _say(failed)
    elif isinstance(error, OSError):
        _say(_of_system(error))
    else:
        raise error  # such as SystemExit
    return ExitCode.BAD_INPUT


def _has_left(error: BaseException) -> bool:
    """Whether the reader of a pipe, such as head, has seen enough; rich then exits with 1."""
    return BrokenPipeError in (type(error), type(error.__context__)) and not isinstance(error, TaxelflowError)


def _of_system(error: OSError) -> str:
    if error.errno == errno.ENOSPC and error.filename in (None, OUTPUT):
        error.filename = OUTPUT
        _drop_output()
    remedy = _REMEDIES.get(error.errno or 0, "check the path and permissions")
    return f"{error.strerror or error}: {error.filename}; {remedy}"


def _drop_output() -> None:
    """What waits in the buffer would raise again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _say(message: object) -> None:
    sys.stderr.write(f"taxelflow: {message}\n")
