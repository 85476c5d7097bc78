from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from synthetic import dome, grid_sensor, recorded
from taxelflow.acquire.base import Recording
from taxelflow.sensors.sensor import Sensor
from warm import warm_up

settings.register_profile("taxelflow", deadline=None, max_examples=40, derandomize=True, database=None)
settings.load_profile("taxelflow")

CHECKOUT = Path(__file__).resolve().parents[1]


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the kernels before workers start; a run in one process compiles what it needs."""
    if getattr(session.config.option, "numprocesses", None):
        warm_up()


@pytest.fixture(scope="session")
def recordings() -> Path:
    folder = Path(os.environ.get("TAXELFLOW_DATA") or CHECKOUT.parent / "shared" / "data")
    if not (folder / "sdh-dsa").is_dir():
        pytest.skip(f"the real recordings are not in {folder}; set TAXELFLOW_DATA to the folder that holds sdh-dsa/")
    return folder


@pytest.fixture
def palm() -> Sensor:
    return grid_sensor(4, 7)


@pytest.fixture
def stroke(palm: Sensor) -> Recording:
    """A dome over the palm: 20 idle scans, 40 in contact of which 20 move right at 20 mm/s, 20 idle; 10 Hz."""
    random = np.random.default_rng(5)
    x = np.concatenate([np.full(10, -0.02), np.linspace(-0.018, 0.02, 20), np.full(10, 0.02)])
    contact = [dome(palm, place) for place in x]
    idle = np.zeros((20, palm.layout.taxels))
    values = np.concatenate([idle, contact, idle]) + random.normal(0, 100, (80, palm.layout.taxels))
    return recorded(values, palm)
