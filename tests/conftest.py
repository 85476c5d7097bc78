from __future__ import annotations

import functools
import gc
import os
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import settings
from tyro import _docstrings

from synthetic import dome, grid_sensor, recorded
from taxelflow.acquire.base import Recording
from taxelflow.condition import baseline
from taxelflow.runtime.settled import Settled
from taxelflow.sensors.sensor import Sensor
from warm import loading_as_needed, warm_up

if TYPE_CHECKING:
    from collections.abc import Iterator

settings.register_profile("taxelflow", deadline=None, max_examples=25, derandomize=True, database=None)
settings.load_profile("taxelflow")
Settled.checked = True  # every call of every test
gc.disable()  # until tests are collected: none of what is imported is garbage

CHECKOUT = Path(__file__).resolve().parents[1]
FIRST = (
    "test_template",
    "test_real_hands",
    "test_scaling",
    "test_warmup",
    "test_cluster",
    "test_prediction",
    "test_slip",
    "test_rigidity",
    "test_plot",
    "test_centre_of_pressure",
    "test_split",
    "test_hard",
    "test_cli",
    "test_compiling",
    "test_gainfit",
    "test_hand",
    "test_paper",
    "test_api",
    "test_calibrate",
    "test_session",
    "test_simulate",
    "test_controllers",
    "test_stages",
    "test_tare",
)
"""Files of tests that take longest, first: those of `make test-long` take 12 to 83 s, those of `make test` 7 to 14."""


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the kernels before workers start, each of which has one core; a run in one process does what it needs."""
    if getattr(session.config.option, "numprocesses", None):
        for library in ("OPENBLAS", "OMP", "MKL"):
            os.environ.setdefault(f"{library}_NUM_THREADS", "1")
        warm_up()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files that take longest first: else a worker would be left with one of them at the end."""
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(FIRST)))


def pytest_collection_finish() -> None:
    """Leave modules and tests out of garbage collections, each of which would look at all of their objects again."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def loaded_as_needed() -> Iterator[None]:
    """A stream's warm-up would take each worker 15 s.

    It is tested where it matters, in processes of their own (`test_warmup`); commands that tests start do it, too.
    """
    with loading_as_needed():
        yield


@pytest.fixture(scope="session", autouse=True)
def noise_estimated_once() -> Iterator[None]:
    """The noise of the same windows of readings is estimated once, a third of the start of a run on a recording: tests
    condition a recording by every mode, method and way to cut it.
    """
    estimate, known = baseline.estimate_noise, {}

    def found(*given: Any, **named: Any) -> Any:
        arrays = [np.asarray(one) for one in (*given, *named.values())]
        key = *named, *((one.shape, one.dtype.str, sha256(one.tobytes()).digest()) for one in arrays)
        if key not in known:
            known[key] = estimate(*given, **named)
        return known[key].copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baseline, "estimate_noise", found)
        yield


@pytest.fixture(scope="session", autouse=True)
def options_read_once() -> Iterator[None]:
    """tyro reads the sources of a command's options for their help, 20 ms a command: here once for each class."""
    make = staticmethod(functools.cache(_docstrings._ClassTokenization.make))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_docstrings._ClassTokenization, "make", make)
        yield


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
