from __future__ import annotations

import io
import json
import tracemalloc
import zipfile
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from numpy.lib import format as npy

from synthetic import grid_sensor, times
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.npz import open_npz
from taxelflow.errors import (
    RecordingCorrupt,
    RecordingError,
    SensorFileInvalid,
    SensorNeeded,
    TaxelCountWrong,
)
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

SENSOR = grid_sensor(2, 3)
STILL: dict[str, Any] = {"truth_pad": "pad0", "truth_t_s": times(4), "truth_pose": np.zeros((4, 3))}


def save(path: Path, **members: Any) -> Path:
    scans = np.arange(30.0).reshape(5, 6)
    np.savez(path, **{"t": times(5), "pressure": scans, **members})
    return path


def handmade(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def npy_bytes(array: Any, *, declared: tuple[int, ...] | None = None, fortran: bool = False) -> bytes:
    """An .npy member whose header may lie about its shape."""
    file = io.BytesIO()
    array = np.asarray(array)
    header = npy.header_data_from_array_1_0(array)
    header["shape"], header["fortran_order"] = declared or array.shape, fortran
    npy.write_array_header_1_0(file, header)
    return file.getvalue() + array.tobytes()


def assert_unusable(path: Path, match: str | None = None) -> None:
    """Fails as a foreseen error of one line, at opening or at the first scan."""
    with pytest.raises(RecordingError, match=match) as caught:
        open_npz(path, SENSOR).load()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["f8", "f4", "u2", "i4", ">f4", ">u2", "f2"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "compressed"])
def test_numbers_of_any_kind_and_order_come_out_as_they_were(
    tmp_path: Path, kind: str, order: str, packed: bool
) -> None:
    scans = np.random.default_rng(0).integers(0, 2000, (40, 6)).astype(kind, order=order)
    path = tmp_path / "scans.npz"
    (np.savez_compressed if packed else np.savez)(path, t=times(40), pressure=scans)
    recording = open_npz(path, SENSOR)
    assert recording.scans == 40
    raw = recording.load()
    assert raw.values.dtype == np.float64
    np.testing.assert_array_equal(raw.values, scans)
    np.testing.assert_array_equal(raw.t_s, times(40))


def test_times_may_be_of_another_kind_than_the_scans(tmp_path: Path) -> None:
    raw = open_npz(save(tmp_path / "a.npz", t=np.arange(5, dtype=np.int64)), SENSOR).load()
    np.testing.assert_array_equal(raw.t_s, np.arange(5.0))


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_long_recording_is_read_in_blocks_and_again(tmp_path: Path, order: str) -> None:
    scans = np.random.default_rng(0).random((2500, 6))
    np.savez(tmp_path / "a.npz", t=times(2500), pressure=np.asarray(scans, order=order))  # type: ignore[call-overload]
    recording = open_npz(tmp_path / "a.npz", SENSOR)
    for _ in range(2):
        np.testing.assert_array_equal(recording.load().values, scans)


def test_memory_stays_constant_while_reading(tmp_path: Path) -> None:
    scans = np.zeros((200_000, 6))
    np.savez_compressed(tmp_path / "a.npz", t=times(200_000), pressure=scans)
    recording = open_npz(tmp_path / "a.npz", SENSOR)
    tracemalloc.start()
    try:
        count = sum(len(block) for block in recording.blocks())
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == 200_000
    assert peak < scans.nbytes / 5


def test_missing_taxels_stay_unknown(tmp_path: Path) -> None:
    scans = np.ones((5, 6))
    scans[2, 3] = np.nan
    raw = open_npz(save(tmp_path / "a.npz", pressure=scans), SENSOR).load()
    np.testing.assert_array_equal(np.argwhere(np.isnan(raw.values)), [[2, 3]])


@pytest.mark.parametrize("memory", ["C", "F"])
@pytest.mark.parametrize("order", ["row-major", "column-major"])
def test_scans_may_be_images_of_a_full_grid(tmp_path: Path, order: str, memory: str) -> None:
    pad = msgspec.structs.replace(SENSOR.pads[0], order=order, first="bottom-left")
    sensor = msgspec.structs.replace(SENSOR, pads=(pad,))
    images = np.random.default_rng(0).random((40, 2, 3))
    np.savez(tmp_path / "a.npz", t=times(40), pressure=np.asarray(images, order=memory))  # type: ignore[call-overload]
    recording = open_npz(tmp_path / "a.npz", sensor)
    assert recording.scans == 40
    values = recording.load().values
    np.testing.assert_array_equal(sensor.layout.grid(0, values[7]), images[7])
    np.testing.assert_array_equal(values, images.reshape(40, 6))
    (sent,) = recording.source_blocks()
    np.testing.assert_array_equal(sent.values, sensor.channel_map.to_source(values))


def test_three_numbers_of_each_taxel_may_have_an_axis(tmp_path: Path) -> None:
    sensor, numbers = grid_sensor(2, 3, axes=3, normal="z"), np.random.default_rng(0).random((40, 6, 3))
    np.savez(tmp_path / "a.npz", t=times(40), pressure=numbers)
    np.testing.assert_array_equal(open_npz(tmp_path / "a.npz", sensor).load().values, numbers[..., 2])
    with pytest.raises(TaxelCountWrong, match="for readings of one axis give a sensor file without axes = 3"):
        open_npz(save(tmp_path / "b.npz", pressure=np.zeros((5, 6))), sensor)


@pytest.mark.parametrize("order", ["row-major", "column-major"])
def test_images_of_three_axes_are_read_as_pictures(tmp_path: Path, order: str) -> None:
    sensor = grid_sensor(2, 3, axes=3, normal="z", shear=("x", "y"))
    pad = msgspec.structs.replace(sensor.pads[0], order=order, first="bottom-left")
    sensor = msgspec.structs.replace(sensor, pads=(pad,))
    images = np.random.default_rng(0).random((40, 2, 3, 3))
    np.savez(tmp_path / "a.npz", t=times(40), pressure=images)
    np.save(tmp_path / "a.npy", images)
    for name, columns in (("a.npz", None), ("a.npy", Columns(rate_hz=100.0))):
        found = read(tmp_path / name, sensor, columns=columns).load()
        assert found.shear is not None
        np.testing.assert_array_equal(found.values, images[..., 2].reshape(40, 6))
        np.testing.assert_array_equal(found.shear, images[..., :2].reshape(40, 6, 2))
    with pytest.raises(RecordingCorrupt, match="no full grid"):
        read(save(tmp_path / "b.npz", pressure=images[:5]), grid_sensor(2, 3))
    np.save(tmp_path / "b.npy", images.transpose(0, 2, 1, 3))
    with pytest.raises(
        RecordingCorrupt, match=r"its scans have shape \(3, 2, 3\), and the grid of sensor grid \(2, 3\)"
    ):
        read(tmp_path / "b.npy", sensor, columns=Columns(rate_hz=100.0))


@pytest.mark.parametrize(
    ("sensor", "shape"),
    [(SENSOR, (5, 3, 2)), (grid_sensor(2, 3, pads=2), (5, 2, 3)), (grid_sensor(2, 3, missing=((0, 1),)), (5, 2, 3))],
    ids=["transposed", "two pads", "gap"],
)
def test_images_that_are_no_full_grid_are_refused(tmp_path: Path, sensor: Sensor, shape: tuple[int, ...]) -> None:
    says = rf"pressure has shape \({', '.join(map(str, shape))}\), which is no full grid of sensor grid; give pressure"
    with pytest.raises(RecordingCorrupt, match=says):
        open_npz(save(tmp_path / "a.npz", pressure=np.zeros(shape)), sensor)


def test_a_sensor_is_asked_for_where_none_is_known(tmp_path: Path) -> None:
    with pytest.raises(SensorNeeded, match=r"--sensor NAME \(.*barretthand-162.*schunk-sdh2"):
        read(save(tmp_path / "a.npz"))


def test_the_file_may_carry_its_sensor(tmp_path: Path) -> None:
    text = msgspec.json.encode(SENSOR).decode()
    recording = read(save(tmp_path / "a.npz", sensor=text))
    assert recording.sensor == SENSOR


def test_a_named_sensor_replaces_the_one_in_the_file(tmp_path: Path) -> None:
    other = grid_sensor(3, 2)
    recording = read(save(tmp_path / "a.npz", sensor=msgspec.json.encode(SENSOR).decode()), other)
    assert recording.sensor == other


def test_a_broken_sensor_in_the_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingCorrupt, match="sensor"):
        read(save(tmp_path / "a.npz", sensor="{not json"))
    with pytest.raises(RecordingError, match="sensor"):
        read(save(tmp_path / "b.npz", sensor=np.arange(3.0)))
    table = json.loads(msgspec.json.encode(SENSOR))
    table["pads"][0]["rows"] = 0
    with pytest.raises(SensorFileInvalid, match=r"c\.npz.*rows"):
        read(save(tmp_path / "c.npz", sensor=json.dumps(table)))


def test_a_wrong_taxel_count_names_both_and_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(TaxelCountWrong, match=r"6 taxels per scan but sensor 'schunk-sdh2' has 456; .*--sensor"):
        read(save(tmp_path / "a.npz"), "schunk-sdh2")


def test_truth_and_masks_make_the_round_trip(tmp_path: Path) -> None:
    masked = np.array([False, True, False, False, False, True])
    pose = np.arange(12.0).reshape(4, 3)
    path = save(tmp_path / "a.npz", masked=masked, truth_pad="pad0", truth_t_s=times(4), truth_pose=pose)
    recording = open_npz(path, SENSOR)
    np.testing.assert_array_equal(recording.masked, masked)
    assert recording.truth is not None
    assert recording.truth.pad == "pad0"
    np.testing.assert_array_equal(recording.truth.t_s, times(4))
    np.testing.assert_array_equal(recording.truth.pose, pose)


def test_truth_may_be_in_the_hand_frame_and_hold_slip(tmp_path: Path) -> None:
    truth = {**STILL, "truth_pad": "hand"}
    found = open_npz(save(tmp_path / "a.npz", **truth, truth_slipping=np.array([0, 1, 1, 0], np.uint8)), SENSOR).truth
    assert found is not None
    assert found.pad == "hand"
    assert found.slipping is not None
    assert found.slipping.tolist() == [False, True, True, False]
    without = open_npz(save(tmp_path / "b.npz", **truth), SENSOR).truth
    assert without is not None
    assert without.slipping is None


def test_without_truth_there_is_none(tmp_path: Path) -> None:
    assert open_npz(save(tmp_path / "a.npz"), SENSOR).truth is None


@pytest.mark.parametrize(
    "members",
    [
        {"masked": np.zeros(4, dtype=bool)},
        {"masked": np.zeros((2, 3), dtype=bool)},
        {"masked": np.array(["x"] * 6)},
        {"truth_pad": "pad0", "truth_t_s": times(4), "truth_pose": np.zeros((4, 2))},
        {"truth_pad": "pad0", "truth_t_s": times(3), "truth_pose": np.zeros((4, 3))},
        {"truth_pad": "nowhere", "truth_t_s": times(4), "truth_pose": np.zeros((4, 3))},
        {**STILL, "truth_slipping": np.zeros(3, dtype=bool)},
        {**STILL, "truth_slipping": np.zeros(4)},
        {"truth_slipping": np.zeros(4, dtype=bool)},
        {**STILL, "truth_second": np.zeros((3, 3))},
        {**STILL, "truth_second": np.zeros((4, 3), dtype=int)},
    ],
    ids=[
        "mask too short",
        "mask as a grid",
        "mask of text",
        "pose of two",
        "pose without times",
        "unknown pad",
        "slip too short",
        "slip of fractions",
        "slip without truth",
        "second pose too short",
        "second pose of whole numbers",
    ],
)
def test_masks_and_truth_that_do_not_fit_are_refused(tmp_path: Path, members: dict[str, Any]) -> None:
    assert_unusable(save(tmp_path / "a.npz", **members))


def test_missing_members_are_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=times(5), p=np.zeros((5, 6)))
    assert_unusable(tmp_path / "a.npz", r"it holds p, time; write it with numpy\.savez")
    np.savez(tmp_path / "b.npz")
    assert_unusable(tmp_path / "b.npz", "nothing")


@pytest.mark.parametrize(
    "members",
    [
        {"t": times(4)},
        {"t": np.zeros((5, 1))},
        {"t": np.array(0.0)},
        {"pressure": np.zeros(5)},
        {"pressure": np.zeros((5, 3, 2))},
        {"pressure": np.zeros((5, 1, 2, 3))},
        {"pressure": np.zeros((5, 6), dtype=complex)},
        {"pressure": np.full((5, 6), "1")},
        {"t": np.array(["a", "b", "c", "d", "e"])},
        {"t": times(5).astype(complex)},
        {"t": np.zeros(5, dtype="M8[s]")},
        {"t": np.zeros(0), "pressure": np.zeros((0, 6))},
    ],
    ids=[
        "fewer times",
        "times in columns",
        "one time",
        "flat scans",
        "scans as other grids",
        "scans of four axes",
        "complex scans",
        "scans of text",
        "times of text",
        "complex times",
        "dates",
        "no scans",
    ],
)
def test_wrong_shapes_and_kinds_are_refused(tmp_path: Path, members: dict[str, Any]) -> None:
    assert_unusable(save(tmp_path / "a.npz", **members))


class Bomb:
    """Unpickling this creates a file."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return open, (str(self.mark), "w")


@pytest.mark.parametrize("member", ["t", "pressure", "masked", "truth_pad", "truth_slipping", "sensor"])
def test_pickled_objects_are_refused_and_never_run(tmp_path: Path, member: str) -> None:
    mark = tmp_path / "mark"
    shape = {"t": 5, "pressure": (5, 6), "masked": 6}.get(member, ())
    objects = np.full(shape, None, dtype=object)
    objects[...] = Bomb(mark)
    truth = {**STILL, "truth_slipping": np.zeros(4, dtype=bool)}
    assert_unusable(save(tmp_path / "a.npz", **{**truth, member: objects}))
    assert not mark.exists()


@pytest.mark.parametrize("fortran", [False, True], ids=["C", "F"])
def test_a_huge_declared_shape_does_not_allocate(tmp_path: Path, fortran: bool) -> None:
    scans = 10**11
    path = handmade(
        tmp_path / "a.npz",
        {
            "t.npy": npy_bytes(times(5), declared=(scans,)),
            "pressure.npy": npy_bytes(np.zeros((5, 6)), declared=(scans, 6), fortran=fortran),
        },
    )
    tracemalloc.start()
    try:
        assert_unusable(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 20e6


def test_a_huge_declared_extra_member_does_not_allocate(tmp_path: Path) -> None:
    path = handmade(
        tmp_path / "a.npz",
        {
            "t.npy": npy_bytes(times(5)),
            "pressure.npy": npy_bytes(np.zeros((5, 6))),
            "masked.npy": npy_bytes(np.zeros(6), declared=(10**12,)),
        },
    )
    assert_unusable(path)


def test_data_that_end_too_early_are_read_as_far_as_they_go(tmp_path: Path) -> None:
    path = handmade(
        tmp_path / "a.npz",
        {
            "t.npy": npy_bytes(times(3000)),
            "pressure.npy": npy_bytes(np.ones((2500, 6)), declared=(3000, 6)),
        },
    )
    reading = open_npz(path, SENSOR).blocks()
    count = sum(len(block) for block in reading)
    assert reading.loss is not None
    assert reading.loss.expected == 3000
    assert count == reading.loss.read
    assert 2048 <= count <= 2500


def test_a_file_that_is_no_archive_is_corrupt(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(b"not a zip at all")
    assert_unusable(path, "zip")
    path.write_bytes(b"")
    assert_unusable(path)


def test_a_truncated_archive_is_corrupt(tmp_path: Path) -> None:
    path = save(tmp_path / "a.npz")
    path.write_bytes(path.read_bytes()[:-100])
    assert_unusable(path)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_damaged_compressed_data_are_a_foreseen_error_or_a_reported_loss(
    tmp_path: Path, order: str, share: float
) -> None:
    path = tmp_path / "a.npz"
    scans = np.random.default_rng(0).random((3000, 6))
    np.savez_compressed(path, t=times(3000), pressure=np.asarray(scans, order=order))  # type: ignore[call-overload]
    content = bytearray(path.read_bytes())
    place = int(len(content) * share)
    content[place : place + 200] = bytes(200)
    path.write_bytes(content)
    try:
        reading = open_npz(path, SENSOR).blocks()
        count = sum(len(block) for block in reading)
    except RecordingError:
        return
    assert reading.loss is not None
    assert count < 3000


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_all_versions_of_the_format_are_read(tmp_path: Path, version: tuple[int, int]) -> None:
    members = {}
    for name, array in (("t", times(5)), ("pressure", np.ones((5, 6)))):
        file = io.BytesIO()
        npy.write_array(file, array, version=version)
        members[f"{name}.npy"] = file.getvalue()
    assert len(open_npz(handmade(tmp_path / "a.npz", members), SENSOR).load()) == 5


@pytest.mark.parametrize(
    "members",
    [
        {"t": b"", "pressure": b""},
        {"t.npy": b"", "pressure.npy": b""},
        {"t.npy": b"\x93NUMPY\x01\x00", "pressure.npy": b"\x93NUMPY\x01\x00"},
        {"t.npy": b"\x93NUMPY\x09\x00" + bytes(80), "pressure.npy": b"\x93NUMPY\x09\x00" + bytes(80)},
        {"t.npy": npy_bytes(times(5)), "pressure": npy_bytes(np.zeros((5, 6)))},
    ],
    ids=["bare names", "empty members", "cut headers", "unknown version", "one bare name"],
)
def test_archives_that_are_no_npz_are_refused(tmp_path: Path, members: dict[str, bytes]) -> None:
    assert_unusable(handmade(tmp_path / "a.npz", members))


def test_members_that_are_no_arrays_do_no_harm_or_are_refused(tmp_path: Path) -> None:
    path = handmade(
        tmp_path / "a.npz",
        {"t.npy": npy_bytes(times(5)), "pressure.npy": npy_bytes(np.zeros((5, 6))), "readme.txt": b"hello"},
    )
    try:
        assert len(open_npz(path, SENSOR).load()) == 5
    except RecordingError as error:
        assert "readme.txt" in str(error)
