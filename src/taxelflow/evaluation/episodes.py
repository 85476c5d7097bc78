"""Episodes of a LeRobot data set: a recording, with its results if they are asked for, or a trial."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.pipeline import api
from taxelflow.publish.lerobot import Episode, check_lerobot, write_lerobot

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.evaluation.control import Course

AXES = ("vx_m_s", "vy_m_s", "omega_rad_s")


def recording_to_lerobot(recording: Recording, directory: Path, method: str | None) -> int:
    """Write a recording as one episode; the number of frames. method: estimator whose results go with it.

    Columns: `observation.pressure` (taxels), Pa, NaN where a reading is missing; `observation.t_s`, the sensor's stamp;
    with results `observation.velocity` (3 per pad), NaN where unknown, and `observation.slipping` (pads).
    Raises ParameterInvalid for a recording of fewer than two scans, and what reading and estimating raise.
    """
    check_lerobot(directory)
    scans = [scans for scans in recording.blocks() if len(scans)]
    t_s = np.concatenate([block.t_s for block in scans]) if scans else np.zeros(0)
    if len(t_s) < 2:
        raise ParameterInvalid("recording", f"{len(t_s)} scans", "have at least 2")
    pressure = recording.sensor.to_si * np.concatenate([block.values for block in scans])
    columns = {"observation.pressure": pressure.astype(np.float32), "observation.t_s": t_s}
    names: dict[str, list[str]] = {}
    if method is not None:
        result = api.estimate(recording, method=method)
        rows = np.clip(np.searchsorted(result.slips.t_s, t_s, side="right") - 1, 0, None)
        velocity = result.slips.velocity[rows].reshape(len(t_s), -1)
        columns["observation.velocity"] = velocity.astype(np.float32)
        columns["observation.slipping"] = result.slipping[rows].astype(np.float32)
        names["observation.velocity"] = [f"{pad}.{axis}" for pad in result.pads for axis in AXES]
        names["observation.slipping"] = list(result.pads)
    rate_hz = (len(t_s) - 1) / max(float(t_s[-1] - t_s[0]), 1e-9)
    task = f"{recording.sensor.name} {method or 'readings'}"
    write_lerobot([Episode(task, columns, names)], directory, rate_hz, recording.sensor.name)
    return len(t_s)


def courses_to_lerobot(courses: Iterable[Course], directory: Path) -> int:
    """Run trials and write each as an episode; their number.

    Columns: `observation.pressure`, `observation.velocity`, `observation.slipping`, `observation.state` (joints,
    and force, N) and `action`, the force per pad that was commanded for the next scan, N.
    Raises ExtraMissing, ParameterInvalid, both before the first trial.
    """
    check_lerobot(directory, "lerobot")
    episodes = []
    for course in courses:
        rows = [(one, course.plant.joints) for one in course]
        seen, closed = zip(*rows, strict=True)
        force = np.array([one.touch.force_n for one in seen])[:, np.newaxis]
        commanded = np.array([one.commanded_n for one in seen])
        columns = {
            "observation.pressure": np.stack([one.moment.readings.ravel() for one in seen]),
            "observation.velocity": np.stack([one.touch.velocity.ravel() for one in seen]),
            "observation.slipping": np.stack([one.touch.slipping for one in seen]),
            "observation.state": np.hstack([np.stack(closed), force]),
            "action": np.append(commanded[1:], commanded[-1])[:, np.newaxis],
        }
        floats = {name: values.astype(np.float32) for name, values in columns.items()}
        names = {"observation.state": [*course.plant.joint_names, "force_n"], "action": ["force_n"]}
        trial = course.trial
        episodes.append(Episode(f"hold the {trial.object}: {trial.event}", floats, names))
    write_lerobot(episodes, directory, course.plant.rate_hz, course.plant.sensor.name)
    return len(episodes)
