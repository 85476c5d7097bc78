from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from taxelflow.errors import GraphicsMissing, NameUnknown

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed: pip install 'taxelflow[sim]'")
pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")

from taxelflow.simulation.mujoco.environment import ID, GripHold  # noqa: E402


@pytest.mark.long
@pytest.mark.parametrize(
    ("imports", "prefix"),
    [("gymnasium, taxelflow", ""), ("gymnasium", "taxelflow.simulation.mujoco.environment:")],
)
def test_a_new_interpreter_makes_it_by_its_name(imports: str, prefix: str) -> None:
    code = f"import {imports}; print(gymnasium.make('{prefix}taxelflow/GripHold-v0').spec.id)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == ID, done.stderr


@pytest.mark.long
def test_it_passes_gymnasiums_check() -> None:
    from gymnasium.utils.env_checker import check_env

    check_env(gymnasium.make(ID, disable_env_checker=True, objects=("ball",)).unwrapped, skip_render_check=True)


def test_a_least_force_too_much_costs_a_quarter_a_second() -> None:
    """From the first scan on, though the support still carries most of the weight then."""
    env = GripHold()
    _, info = env.reset(seed=3, options={"object": "ball", "event": "none"})
    rewards = []
    for _ in range(100):
        _, reward, _, _, info = env.step(np.array([2.0 * info["least_n"] / 40.0], dtype=np.float32))
        rewards.append(reward)
    assert info["slid_m"] < 1e-4
    assert sum(rewards[50:]) == pytest.approx(-0.25 * 0.5, rel=0.1)
    assert min(rewards) > -0.01


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
