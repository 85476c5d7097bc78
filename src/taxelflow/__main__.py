"""`python -m taxelflow` and the command `taxelflow`: quiet on Ctrl-C from their first step."""

import os
import signal
import sys


def _leave(number: int, _frame: object) -> None:
    """End at once, with the exit code of a shell for this signal: nothing has been read or written yet."""
    os._exit(128 + number)


def main() -> int:
    """Import the command line, which takes longer than many commands, and run it."""
    waits = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else the caller ignores it, or handles it
    if waits:
        signal.signal(signal.SIGINT, _leave)
    from taxelflow.cli import main as run

    if waits:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


if __name__ == "__main__":
    sys.exit(main())
