"""A gripper holds a bottle that is filled: its scans come over TCP, `taxelflow.Live` and `Hold` answer with a force.

The gripper is emulated by MuJoCo behind a socket (pip install 'taxelflow[sim]'): a driver of a real one takes its
place. It waits for each answer, so nothing here depends on the speed of the machine.
Run it: python examples/06_live_grip.py
"""

import json
import socket
import threading

import numpy as np

from taxelflow import Conditioner, Live
from taxelflow.control.hold import Hold
from taxelflow.control.touch import Facing
from taxelflow.simulation.mujoco.gripper import sensor_of
from taxelflow.simulation.mujoco.plants import TRIAL
from taxelflow.simulation.mujoco.skin import Skin
from taxelflow.simulation.mujoco.trial import Moment, Rehearsal, Trial

MOST_N = 40.0


class EmulatedGripper(threading.Thread):
    """Closes by itself, then takes a force per pad for each scan that it sends."""

    def __init__(self, trial: Trial) -> None:
        super().__init__(daemon=True)
        self.trial, self.server = trial, socket.create_server(("127.0.0.1", 0))
        self.slid_m = 0.0

    def run(self) -> None:
        connection, _ = self.server.accept()
        with connection, connection.makefile("rw") as line:

            def asked(state: str, moment: Moment) -> float:
                scan = {"state": state, "t_s": moment.truth.t_s, "pa": moment.readings.ravel().tolist()}
                line.write(json.dumps(scan) + "\n")
                line.flush()
                return float(line.readline())

            rehearsal = Rehearsal(self.trial)
            *closing, moment = rehearsal.start()
            for earlier in closing:
                asked("closing", earlier)
            origin, force_n = moment.truth.slid_m, asked("holding", moment)
            while rehearsal.t_s < TRIAL.end_s:
                moment = rehearsal.step(force_n)
                self.slid_m = float(np.linalg.norm(moment.truth.slid_m - origin))
                force_n = asked("holding", moment)


trial = Trial.drawn(7, "bottle", "pour")
gripper = EmulatedGripper(trial)
gripper.start()

sensor = sensor_of(Skin())
live, facing, controller = Live(sensor, "registration", condition=Conditioner(tare="none")), Facing(sensor), None
with socket.create_connection(gripper.server.getsockname()) as connection, connection.makefile("rw") as link:
    for line in link:
        scan, force_n = json.loads(line), 0.0
        readings = np.array(scan["pa"])
        touch = facing.touch(scan["t_s"], readings.reshape(2, -1), live.step(scan["t_s"], readings))
        if scan["state"] == "holding":
            if controller is None:
                controller, first_n = Hold().start(touch.force_n, MOST_N), touch.force_n
                print(f"takes over a grip of {first_n:.1f} N per pad")
            force_n = controller.step(touch)
        link.write(f"{force_n}\n")
        link.flush()
gripper.join()
gripper.server.close()
print(
    f"the weight grew {trial.happening.times:.1f} times: slid {1e3 * gripper.slid_m:.1f} mm, ends with {force_n:.1f} N"
)
print(f"the least that holds is {trial.least_n(TRIAL.end_s):.1f} N")
