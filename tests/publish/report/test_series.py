from __future__ import annotations

import base64
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigged import track
from taxelflow.publish.report.charts import result_chart
from taxelflow.publish.report.series import Packer, binned

if TYPE_CHECKING:
    from taxelflow.messages import Floats

numbers = st.lists(st.one_of(st.just(np.nan), st.floats(-1e4, 1e4)), max_size=80).map(np.array)


def unpacked(packed: dict[str, Any]) -> list[Floats]:
    """What the page's script does, in Python."""
    content = np.frombuffer(zlib.decompress(base64.b64decode(packed["bytes"])), dtype=np.uint8)
    found, at = [], 0
    for head in packed["heads"]:
        known = np.ones(head["n"], dtype=bool)
        if head["known"] < head["n"]:
            length = -(-head["n"] // 8)
            known = np.unpackbits(content[at : at + length], bitorder="little")[: head["n"]].astype(bool)
            at += length
        planes = content[at : at + head["planes"] * head["known"]].reshape(head["planes"], -1).astype(np.int64)
        at += planes.size
        codes = sum((plane << (8 * k) for k, plane in enumerate(planes)), np.zeros(head["known"], np.int64))
        steps = np.where(codes % 2, -(codes + 1) // 2, codes // 2)
        values = np.cumsum(steps)
        out = np.full(head["n"], np.nan)
        out[known] = head["log"][1] * head["log"][0] ** values if "log" in head else values * head["step"]
        found.append(out)
    assert at == len(content)
    return found


@given(st.lists(st.tuples(numbers, st.sampled_from([1e-3, 0.01, 0.5])), min_size=1, max_size=4))
def test_series_come_back_within_half_a_step_and_unknown_where_they_were(series: list[tuple[Floats, float]]) -> None:
    packer = Packer()
    assert [packer.add(values, step) for values, step in series] == list(range(len(series)))
    for (values, step), back in zip(series, unpacked(packer.packed()), strict=True):
        np.testing.assert_array_equal(np.isnan(back), np.isnan(values))
        assert np.nanmax(np.abs(back - values), initial=0.0) <= 0.5001 * step


@given(st.lists(st.floats(1e-6, 10.0), min_size=1, max_size=40).map(np.array))
def test_standard_deviations_come_back_within_3_percent(std: Floats) -> None:
    packer = Packer()
    packer.add_log(std)
    (back,) = unpacked(packer.packed())
    np.testing.assert_allclose(back, std, rtol=0.03)


@given(numbers, st.integers(1, 9))
def test_bins_hold_every_value_between_their_ends(values: Floats, width: int) -> None:
    low, high = binned(values, width)
    assert len(low) == len(high) == -(-len(values) // width)
    for k, value in enumerate(values):
        if np.isfinite(value):
            assert low[k // width] <= value <= high[k // width]
    own = [values[k * width : (k + 1) * width] for k in range(len(low))]
    for k, part in enumerate(own):
        if np.isfinite(part).any():
            assert (low[k], high[k]) == (np.nanmin(part), np.nanmax(part))
        else:
            assert np.isnan(low[k])
            assert np.isnan(high[k])


@pytest.mark.parametrize(("most_bytes", "width"), [(1e6, 1), (6000, 4), (1500, 16)])
def test_scans_are_put_together_until_they_fit(most_bytes: float, width: int) -> None:
    rng = np.random.default_rng(0)
    walk = track(*(1e-4 * np.cumsum(rng.normal(size=(2, 1500)), axis=1)), pad="pad")
    for name in ("std_x_m", "std_y_m", "std_theta_rad", "load_pa"):
        walk.numbers[name] = rng.uniform(1e-5, 1e-4, 1500)
    walk.numbers["theta_rad"] = np.full(1500, np.nan)
    chart = result_chart([walk], [], 0.0, {"label": "mine"}, most_bytes)
    assert chart["width"] == width
    assert len(chart["packed"]["bytes"]) <= most_bytes
    series = unpacked(chart["packed"])
    own = chart["tracks"]["pad"]["x"]
    for index, ends in zip((own["lo"], own["hi"]), binned(1e3 * walk.numbers["x_m"], width), strict=True):
        np.testing.assert_allclose(series[index], ends, atol=0.0051)
    assert "theta" not in chart["tracks"]["pad"]


def test_bands_are_those_of_ok_poses() -> None:
    ok = np.arange(10) < 4
    walk = track(np.linspace(0.0, 1e-3, 10), np.zeros(10), pad="pad", ok=ok)
    walk.numbers.update({name: np.full(10, 1e-4) for name in ("std_x_m", "std_y_m", "std_theta_rad", "load_pa")})
    walk.numbers["theta_rad"] = np.full(10, np.nan)
    chart = result_chart([walk], [], 0.0, {"label": "mine"}, 1e6)
    series, own = unpacked(chart["packed"]), chart["tracks"]["pad"]["x"]
    np.testing.assert_array_equal(np.isfinite(series[own["std"]]), ok)
    assert np.isfinite(series[own["lo"]]).all()
