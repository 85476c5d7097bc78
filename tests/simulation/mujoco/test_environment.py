from __future__ import annotations

import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from taxelflow.errors import GraphicsMissing, NameUnknown

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed: pip install 'taxelflow[sim]'")
pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")

from taxelflow.simulation.mujoco.environment import ID, GripHold, register  # noqa: E402

CHECKOUT = Path(__file__).parents[3]


def test_the_entry_point_registers_the_environment() -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, name = project["entry-points"]["gymnasium.envs"]["taxelflow"].partition(":")
    assert getattr(import_module(module), name) is register
    register()
    made = gymnasium.make(ID, disable_env_checker=True)
    assert isinstance(made.unwrapped, GripHold)


def test_it_passes_gymnasiums_check() -> None:
    from gymnasium.utils.env_checker import check_env

    register()
    check_env(gymnasium.make(ID, disable_env_checker=True, objects=("ball",)).unwrapped, skip_render_check=True)


def test_a_firm_grip_holds_and_an_open_one_drops() -> None:
    env = GripHold()
    totals, ends = [], []
    for share in (2.0, 0.0):
        _, info = env.reset(seed=3, options={"object": "ball", "event": "none"})
        assert info["grasped"]
        total, ended = 0.0, False
        while not ended:
            seen, reward, lost, over, info = env.step(np.array([share * info["least_n"] / 40.0], dtype=np.float32))
            total, ended = total + reward, lost or over
        totals.append(total)
        ends.append((lost, over))
        assert seen in env.observation_space
    assert ends == [(False, True), (True, False)]
    assert totals[0] > -2.0 > totals[1]


def test_an_unknown_object_is_refused() -> None:
    with pytest.raises(NameUnknown, match="unknown object 'bal'"):
        GripHold().reset(options={"object": "bal"})


def test_it_renders_off_screen() -> None:
    env = GripHold(render_mode="rgb_array")
    env.reset(seed=3)
    try:
        frame = env.render()
    except GraphicsMissing as error:
        pytest.skip(str(error))
    assert frame.shape == (480, 480, 3)
    assert frame.std() > 5
    env.close()
