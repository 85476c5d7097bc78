"""Exit codes of commands beside 0."""

from enum import IntEnum
from signal import SIGINT


class ExitCode(IntEnum):
    """What a command ends with."""

    PARTLY_DONE = 1
    BAD_INPUT = 2
    INTERRUPTED = 128 + SIGINT
    """That of a shell for a process ended by Ctrl+C."""
