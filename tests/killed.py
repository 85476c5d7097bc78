"""How much `taxelflow record` loses when it is killed: `python tests/killed.py [KILLS] [SEED]` kills it with SIGKILL at
random moments, reads what it left, and prints how long before the kill the first scan was sent that is missing.
"""

from __future__ import annotations

import random
import socket
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from taxelflow.pipeline import api

_SENSOR, _COLUMNS, _RATE_HZ = "barretthand-162", 162, 200.0
_SHORTEST_S, _LONGEST_S = 0.3, 6.0


def lost_s(out: Path, after_s: float) -> tuple[int, int, float]:
    """Record for so long, kill: scans sent, scans read, and the time that is lost, s."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"tcp://127.0.0.1:{server.getsockname()[1]}?wait=60"
        command = [sys.executable, "-m", "taxelflow.cli", "record", url, str(out), "--sensor", _SENSOR, "--quiet"]
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
            connected, _ = server.accept()
            sent_s: list[float] = []
            with connected:
                began = time.monotonic()
                while time.monotonic() - began < after_s:
                    t_s = len(sent_s) / _RATE_HZ
                    time.sleep(max(0.0, began + t_s - time.monotonic()))
                    numbers = [f"{4000 + (len(sent_s) + column) % 1000}" for column in range(_COLUMNS)]
                    connected.sendall(",".join([f"{t_s:.6f}", *numbers, ""])[:-1].encode() + b"\n")
                    sent_s.append(time.monotonic())
                killed_s = time.monotonic()
                process.kill()
                process.wait()
    read = sum(len(block) for block in api.read(out).blocks())
    return len(sent_s), read, killed_s - sent_s[read] if read < len(sent_s) else 0.0


def main(kills: int, seed: int) -> None:
    """Print a line per kill, and the worst."""
    moments, worst_s = random.Random(seed), 0.0
    with TemporaryDirectory() as folder:
        for kill in range(kills):
            after_s = moments.uniform(_SHORTEST_S, _LONGEST_S)
            sent, read, gone_s = lost_s(Path(folder) / f"{kill}.mcap", after_s)
            worst_s = max(worst_s, gone_s)
            print(f"killed after {after_s:.2f} s: {sent} sent, {read} read, {gone_s:.2f} s lost", flush=True)
    print(f"at most {worst_s:.2f} s lost in {kills} kills")


if __name__ == "__main__":
    given = [int(argument) for argument in sys.argv[1:]]
    main(given[0] if given else 20, given[1] if len(given) > 1 else 17)
