"""Exit codes of commands beside 0; the last is that of a shell for a process ended by Ctrl+C."""

from signal import SIGINT

PARTLY_DONE, BAD_INPUT, INTERRUPTED = 1, 2, 128 + SIGINT
