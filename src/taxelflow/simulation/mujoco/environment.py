"""The trials as a Gymnasium environment, `taxelflow/GripHold-v0`: readings in, a force per pad out.

Importing this module registers it, as does importing `taxelflow` after `gymnasium`. Gymnasium itself looks for no
plugins since 1.0; it imports a module that is named before the colon of `MODULE:taxelflow/GripHold-v0`.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from taxelflow.simulation.mujoco.events import STANDARD_EVENTS
from taxelflow.simulation.mujoco.objects import STANDARD_OBJECTS
from taxelflow.simulation.mujoco.plant import Actuator
from taxelflow.simulation.mujoco.plants import TRIAL
from taxelflow.simulation.mujoco.skin import Skin
from taxelflow.simulation.mujoco.trial import Rehearsal, Trial

ID = "taxelflow/GripHold-v0"
_MOST_SEED = 2**31
"""Seeds of trials that are drawn are below this."""
Observation = dict[str, NDArray[np.float32]]


class GripHold(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Hold what two pads grip, with little slip and little force.

    observation: `pressure` (2, rows, cols), Pa, of the left and the right pad, rows from the top; `joints` (2,), how
    far each pad has closed, m; `force` (1,), N, the last command. action: (1,), the force per pad until the next scan,
    as a share of the gripper's largest (40 N).
    reward: -1 for each 5 mm slid, -0.25 a second for each least force too much, -10 if the object is lost.
    An episode is a trial from the lift on: 3.5 s, 350 scans. `info` has the truth: slid_m, least_n, grasped, and the
    trial's seed, object and event.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 25}  # noqa: RUF012  # Gymnasium's own form

    def __init__(
        self,
        objects: tuple[str, ...] = STANDARD_OBJECTS,
        events: tuple[str, ...] = STANDARD_EVENTS,
        *,
        skin: Skin | None = None,
        actuator: Actuator | None = None,
        render_mode: str | None = None,
    ) -> None:
        """objects, events: names to draw from. Raises NameUnknown at the reset that draws an unknown one."""
        self._objects, self._events = objects, events
        self._skin, self._actuator, self.render_mode = skin or Skin(), actuator or Actuator(), render_mode
        shape, most = (2, self._skin.rows, self._skin.cols), self._actuator.max_n
        self.observation_space: Any = gymnasium.spaces.Dict(
            {
                "pressure": gymnasium.spaces.Box(0.0, self._skin.full_scale_pa, shape, np.float32),
                "joints": gymnasium.spaces.Box(-0.1, 0.1, (2,), np.float32),
                "force": gymnasium.spaces.Box(0.0, most, (1,), np.float32),
            }
        )
        self.action_space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float32)
        self._rehearsal: Rehearsal | None = None
        self._camera: Any = None
        self._slid_m = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a trial, and close the gripper. options: `object` and `event` by name, `seed` of the trial itself."""
        super().reset(seed=seed)
        asked = options or {}
        number = int(asked.get("seed", self.np_random.integers(_MOST_SEED)))
        kind = str(asked.get("object", self.np_random.choice(self._objects)))
        event = str(asked.get("event", self.np_random.choice(self._events)))
        self.close()
        trial = Trial.drawn(number, kind, event)
        self._rehearsal = Rehearsal(trial, self._skin, self._actuator)
        *_, moment = self._rehearsal.start()
        self._origin, self._slid_m = moment.truth.slid_m, 0.0
        return self._seen(moment.readings, min(trial.first_n, self._actuator.max_n)), self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One scan; Gymnasium's five."""
        rehearsal = self._started()
        force_n = self._actuator.max_n * float(np.clip(action, 0.0, 1.0).item())
        moment = rehearsal.step(force_n)
        slid_m, before_m = float(np.linalg.norm(moment.truth.slid_m - self._origin)), self._slid_m
        self._slid_m = slid_m
        excess = max(moment.truth.force_n / self._least_n(moment.truth.t_s) - 1.0, 0.0)
        dt_s = 1.0 / rehearsal.plant.rate_hz
        lost = slid_m >= TRIAL.dropped_m
        reward = -abs(slid_m - before_m) / TRIAL.near_m - TRIAL.force_cost * excess * dt_s + lost * TRIAL.lost
        over = rehearsal.t_s >= TRIAL.end_s - 1e-9
        return self._seen(moment.readings, force_n), reward, lost, over and not lost, self._info()

    def render(self) -> Any:
        """(height, width, 3) uint8 with render_mode "rgb_array", else None. Raises GraphicsMissing."""
        if self.render_mode is None:
            return None
        from taxelflow.simulation.mujoco.camera import Camera

        self._camera = self._camera or Camera(self._started().plant)
        return self._camera.frame()

    def close(self) -> None:
        """Give the graphics context back."""
        if self._camera is not None:
            self._camera.close()
        self._camera = None

    def _started(self) -> Rehearsal:
        if self._rehearsal is None:
            raise gymnasium.error.ResetNeeded("call reset() first")
        return self._rehearsal

    def _least_n(self, t_s: float) -> float:
        """Least force per pad that holds; that of the whole weight while the support still carries some of it."""
        return self._started().trial.least_n(max(t_s, TRIAL.lifted_s))

    def _seen(self, readings: NDArray[np.float64], force_n: float) -> Observation:
        parts = {
            "pressure": readings.reshape(self.observation_space["pressure"].shape),
            "joints": self._started().plant.joints,
            "force": np.array([force_n]),
        }
        return {name: part.astype(np.float32) for name, part in parts.items()}

    def _info(self) -> dict[str, Any]:
        rehearsal = self._started()
        trial = rehearsal.trial
        truth = {"slid_m": self._slid_m, "least_n": self._least_n(rehearsal.t_s), "grasped": rehearsal.grasped}
        return {**truth, "seed": trial.seed, "object": trial.object, "event": trial.event}


if ID not in gymnasium.registry:
    gymnasium.register(ID, entry_point=f"{__name__}:{GripHold.__name__}")
