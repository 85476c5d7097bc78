from __future__ import annotations

import bz2
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from synthetic import DsaMatrix, dsa_words, dsa_xml, grid_sensor, write_dsa
from taxelflow.acquire import limits
from taxelflow.acquire.dsa import _elements, open_dsa
from taxelflow.errors import RecordingCorrupt, RecordingError, RecordingTooLarge, TaxelCountWrong, TimesNotIncreasing
from taxelflow.pipeline.api import estimate, read

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Reading

SCANS = {
    "masked_matrix": 519,
    "reactive_grasping": 239,
    "slip_and_rotation_teapot_handle": 109,
    "slip_examples_pen_and_wooden_block": 6893,
    "tennisball": 3594,
}
SMALL = [DsaMatrix(2, 3), DsaMatrix(3, 2)]


def packed(path: Path, text: str) -> Path:
    path.write_bytes(bz2.compress(text.encode()))
    return path


def drain(reading: Reading) -> int:
    return sum(len(block) for block in reading)


def random_scans(scans: int, cells: int = 12) -> Any:
    random = np.random.default_rng(1)
    values = random.integers(0, 4096, (scans, cells)).astype(float)
    return values * (random.random(values.shape) < 0.5)


def test_scans_times_and_layout_come_from_the_file(tmp_path: Path) -> None:
    scans = random_scans(50)
    recording = open_dsa(write_dsa(tmp_path / "a.dsa", scans, SMALL), None)
    raw = recording.load()
    np.testing.assert_array_equal(raw.values, scans)
    np.testing.assert_allclose(raw.t_s, 1.0 + 0.032 * np.arange(50), rtol=0, atol=1e-9)
    assert recording.scans == 50
    assert [(pad.name, pad.rows, pad.cols, pad.pitch_m) for pad in recording.sensor.pads] == [
        ("matrix0", 2, 3, (0.0034, 0.0035)),
        ("matrix1", 3, 2, (0.0034, 0.0035)),
    ]
    assert (recording.sensor.unit, recording.sensor.full_scale) == ("count", 4095.0)


@pytest.mark.parametrize("run_lengths", [True, False])
@pytest.mark.parametrize(
    "cells", [[0] * 12, [5] * 12, [0, 0, 1, 0, 0, 0, 2, 3, 0, 0, 0, 4], [0.0, 0.25, 4095] + [0] * 9]
)
def test_run_lengths_stand_for_zeros(tmp_path: Path, cells: list[float], run_lengths: bool) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words(cells, packed=run_lengths))], promised=1)
    raw = open_dsa(packed(tmp_path / "a.dsa", text), None).load()
    np.testing.assert_array_equal(raw.values, [cells])


def test_zeros_may_be_split_over_several_runs_that_cross_matrices(tmp_path: Path) -> None:
    words = np.array([-4, -5, 7, -2], dtype=">f4").tobytes().hex()
    raw = open_dsa(packed(tmp_path / "a.dsa", dsa_xml(SMALL, [(0, words)], promised=1)), None).load()
    np.testing.assert_array_equal(raw.values, [[0] * 9 + [7, 0, 0]])


@pytest.mark.parametrize("between", [" ", "\n", "\t", "\r\n  "])
def test_whitespace_within_the_hex_is_ignored(tmp_path: Path, between: str) -> None:
    words = dsa_words([1, 2, 3, 0, 0, 0, 4, 5, 6, 0, 0, 7]).replace("\n", "")
    spaced = between.join(words[place : place + 3] for place in range(0, len(words), 3))
    raw = open_dsa(packed(tmp_path / "a.dsa", dsa_xml(SMALL, [(0, spaced.lower())], promised=1)), None).load()
    np.testing.assert_array_equal(raw.values, [[1, 2, 3, 0, 0, 0, 4, 5, 6, 0, 0, 7]])


def test_cells_that_are_absent_are_left_out_and_cells_switched_off_are_masked(tmp_path: Path) -> None:
    matrices = [DsaMatrix(2, 3, static="011111", dynamic="111101"), DsaMatrix(3, 2)]
    scans = random_scans(4)
    recording = open_dsa(write_dsa(tmp_path / "a.dsa", scans, matrices), None)
    assert recording.sensor.pads[0].missing == ((0, 0),)
    np.testing.assert_array_equal(recording.load().values, scans[:, 1:])
    np.testing.assert_array_equal(np.flatnonzero(recording.masked), [3])


def test_an_absent_cell_is_no_masked_taxel(tmp_path: Path) -> None:
    matrices = [DsaMatrix(2, 3, static="011111", dynamic="011111")]
    assert not open_dsa(write_dsa(tmp_path / "a.dsa", random_scans(2, 6), matrices), None).masked.any()


def test_a_named_sensor_of_the_same_size_replaces_the_files(tmp_path: Path) -> None:
    path = write_dsa(tmp_path / "a.dsa", random_scans(4), SMALL)
    other = grid_sensor(3, 4)
    assert open_dsa(path, other).sensor is other
    with pytest.raises(TaxelCountWrong, match=r"12 taxels .* 'schunk-sdh2' has 456"):
        read(path, "schunk-sdh2")


def test_the_geometry_of_the_sdh2_gets_its_names_and_scale(tmp_path: Path) -> None:
    distal = "011110" * 5 + "111111" * 8
    matrices = [DsaMatrix(14, 6), DsaMatrix(13, 6, static=distal)] * 3
    text = dsa_xml(matrices, [(0, dsa_words([0] * 486))], promised=1).replace("3.5<", "3.4<")
    recording = open_dsa(packed(tmp_path / "a.dsa", text), None)
    assert recording.sensor.name == "schunk-sdh2"
    assert recording.layout.taxels == 456
    assert recording.layout.pads[1] == "finger2_distal"


def test_joint_angles_and_temperatures_are_passed_over(tmp_path: Path) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12)), (32, dsa_words([2] * 12))], promised=2)
    extra = (
        "<joint_angles><angle index='0'><time_stamp>1</time_stamp><angle_data>1, 2</angle_data></angle></joint_angles>"
    )
    path = packed(tmp_path / "a.dsa", text.replace("</root>", extra + "</root>"))
    assert len(open_dsa(path, None).load()) == 2


def test_what_is_inside_a_scan_does_not_end_it(tmp_path: Path) -> None:
    inside = "<angle><time_stamp>1</time_stamp></angle><frame_count>7</frame_count>"
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12)), (32, dsa_words([2] * 12))], promised=2)
    raw = open_dsa(packed(tmp_path / "a.dsa", text.replace("<frame_data>", inside + "<frame_data>")), None).load()
    np.testing.assert_array_equal(raw.values, [[1] * 12, [2] * 12])


def test_every_digit_of_a_mask_but_0_stands_for_a_cell(tmp_path: Path) -> None:
    matrices = [DsaMatrix(2, 3, static="021111", dynamic="022011")]
    recording = open_dsa(write_dsa(tmp_path / "a.dsa", random_scans(2, 6), matrices), None)
    assert recording.sensor.pads[0].missing == ((0, 0),)
    assert recording.masked.tolist() == [False, False, True, False, False]


def test_a_file_without_a_frame_count_promises_nothing(tmp_path: Path) -> None:
    recording = open_dsa(packed(tmp_path / "a.dsa", dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=None)), None)
    assert recording.scans is None
    assert len(recording.load()) == 1


def test_a_long_file_comes_in_blocks_and_twice_the_same(tmp_path: Path) -> None:
    scans = random_scans(2100)
    recording = open_dsa(write_dsa(tmp_path / "a.dsa", scans, SMALL), None)
    assert [len(block) for block in recording.blocks()] == [1024, 1024, 52]
    np.testing.assert_array_equal(recording.load().values, scans)


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_truncated_bzip2_is_read_as_far_as_it_goes(tmp_path: Path, share: float) -> None:
    scans = random_scans(3000)
    path = write_dsa(tmp_path / "a.dsa", scans, SMALL)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    reading = open_dsa(path, None).blocks()
    values = np.concatenate([block.values for block in reading])
    assert reading.loss is not None
    assert (reading.loss.read, reading.loss.expected) == (len(values), 3000)
    assert 0.1 * 3000 < len(values) < 3000
    np.testing.assert_array_equal(values, scans[: len(values)])


def test_a_truncated_xml_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    frames = [(32 * number, dsa_words([number + 1] * 12)) for number in range(10)]
    text = dsa_xml(SMALL, frames, promised=10)
    cut_at = text.index('<frame index="7">') + 60
    reading = open_dsa(packed(tmp_path / "a.dsa", text[:cut_at]), None).blocks()
    assert drain(reading) == 7
    assert "7 of 10 scans could be read" in str(reading.loss)


def test_xml_broken_between_frames_is_a_loss_of_what_follows(tmp_path: Path) -> None:
    frames = [(32 * number, dsa_words([number + 1] * 12)) for number in range(10)]
    text = dsa_xml(SMALL, frames, promised=10).replace('<frame index="4">', "<frame <<<")
    reading = open_dsa(packed(tmp_path / "a.dsa", text), None).blocks()
    assert drain(reading) == 4
    assert "4 of 10" in str(reading.loss)


def test_damaged_bzip2_is_a_loss_of_what_follows_or_a_foreseen_error(tmp_path: Path) -> None:
    path = write_dsa(tmp_path / "a.dsa", random_scans(3000), SMALL)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    try:
        reading = open_dsa(path, None).blocks()
        drain(reading)
    except RecordingError:
        return
    assert reading.loss is not None


@pytest.mark.parametrize(("promised", "lost"), [(5, True), (2, True), (1, False)])
def test_frames_that_were_promised_but_are_not_there_are_a_loss(tmp_path: Path, promised: int, lost: bool) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=promised)
    reading = open_dsa(packed(tmp_path / "a.dsa", text), None).blocks()
    assert drain(reading) == 1
    assert (f"1 of {promised}" in str(reading.loss)) == lost


def test_an_unfinished_xml_is_a_loss_even_if_nothing_was_promised(tmp_path: Path) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=None)
    reading = open_dsa(packed(tmp_path / "a.dsa", text.removesuffix("</data>\n</root>\n")), None).blocks()
    assert drain(reading) == 1
    assert "the file ends before its XML does" in str(reading.loss)


def test_an_unfinished_bzip2_is_a_loss_even_if_its_xml_is_whole(tmp_path: Path) -> None:
    path = packed(tmp_path / "a.dsa", dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=1))
    path.write_bytes(path.read_bytes()[:-4])
    reading = open_dsa(path, None).blocks()
    assert drain(reading) == 1
    assert "the file ends before its XML does" in str(reading.loss)


def hexed(*words: float) -> str:
    return np.array(words, dtype=">f4").tobytes().hex()


@pytest.mark.parametrize(
    "words",
    [
        dsa_words([1] * 11),
        dsa_words([1] * 13),
        "",
        "zz" * 48,
        hexed(*[1] * 12)[:-2],
        hexed(-11),
        hexed(-1e9),
        hexed(-np.inf),
        hexed(-0.5, -0.5, *[1] * 11),
        hexed(-1.5, -1.5, *[1] * 9),
    ],
    ids=[
        "one cell less",
        "one cell more",
        "nothing",
        "no hex",
        "half a word",
        "short run",
        "long run",
        "endless run",
        "half runs",
        "broken runs",
    ],
)
def test_a_scan_of_the_wrong_number_of_cells_is_corrupt_after_those_before_it(tmp_path: Path, words: str) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12)), (32, words), (64, dsa_words([1] * 12))], promised=3)
    reading = open_dsa(packed(tmp_path / "a.dsa", text), None).blocks()
    assert len(next(reading)) == 1
    with pytest.raises(RecordingCorrupt, match="scan 1") as caught:
        next(reading)
    assert "\n" not in str(caught.value)


def test_a_reading_that_is_no_number_is_a_missing_taxel(tmp_path: Path) -> None:
    text = dsa_xml(SMALL, [(0, hexed(np.nan, *[1] * 11))], promised=1)
    raw = open_dsa(packed(tmp_path / "a.dsa", text), None).load()
    np.testing.assert_array_equal(np.isnan(raw.values), [[True] + [False] * 11])


@pytest.mark.parametrize("stamp", ["soon", ""])
def test_a_time_that_is_no_number_is_corrupt(tmp_path: Path, stamp: str) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12)), (stamp, dsa_words([1] * 12))], promised=2)
    with pytest.raises(RecordingCorrupt, match="scan 1"):
        open_dsa(packed(tmp_path / "a.dsa", text), None).load()


def test_times_that_run_backwards_are_an_error(tmp_path: Path) -> None:
    text = dsa_xml(SMALL, [(stamp, dsa_words([1] * 12)) for stamp in (10, 20, 15)], promised=3)
    with pytest.raises(TimesNotIncreasing):
        open_dsa(packed(tmp_path / "a.dsa", text), None).load()


@pytest.mark.parametrize(
    "change",
    [
        ("<cells_x>3</cells_x>", ""),
        ("<cells_x>3</cells_x>", "<cells_x>three</cells_x>"),
        ("<cells_x>3</cells_x>", "<cells_x>4</cells_x>"),
        ("<cells_x>3</cells_x>", "<cells_x>0</cells_x>"),
        ("<cells_x>3</cells_x>", "<cells_x>-3</cells_x>"),
        ("<cells_x>3</cells_x>", "<cells_x>99999999999</cells_x>"),
        ("<texel_width>3.4</texel_width>", "<texel_width>0</texel_width>"),
        ("<texel_width>3.4</texel_width>", "<texel_width>nan</texel_width>"),
        ("<texel_width>3.4</texel_width>", "<texel_width>wide</texel_width>"),
        ("<fullscale>4095</fullscale>", ""),
        ("<texel_height>3.5</texel_height>", "<texel_height>-3.5</texel_height>"),
        ("<texel_height>3.5</texel_height>", "<texel_height>inf</texel_height>"),
        ("<static_mask>", "<mask>"),
        ("<frame_count>1</frame_count>", "<frame_count>many</frame_count>"),
        ("<matrix", "<grid"),
    ],
    ids=lambda change: f"{change[0].strip()} to {change[1].strip() or 'nothing'}",
)
def test_a_broken_layout_is_corrupt(tmp_path: Path, change: tuple[str, str]) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=1)
    assert change[0] in text
    with pytest.raises(RecordingError) as caught:
        open_dsa(packed(tmp_path / "a.dsa", text.replace(*change)), None).load()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("rows", "cols"), [(0, 3), (2, 0), (1025, 3), (2, 1025)])
def test_a_matrix_of_impossible_size_is_corrupt(tmp_path: Path, rows: int, cols: int) -> None:
    """Its masks and its scan are of that size too."""
    cells = rows * cols
    text = dsa_xml([DsaMatrix(2, 3)], [(0, dsa_words([0] * cells))], promised=1)
    text = text.replace("111\n111", "1" * cells).replace(">3</cells_x>", f">{cols}</cells_x>")
    path = packed(tmp_path / "a.dsa", text.replace(">2</cells_y>", f">{rows}</cells_y>"))
    with pytest.raises(RecordingCorrupt, match=f"a matrix of {rows} x {cols} cells"):
        open_dsa(path, None)


@pytest.mark.parametrize("digits", ["11111", "1111111"])
def test_a_mask_of_another_size_is_corrupt(tmp_path: Path, digits: str) -> None:
    text = dsa_xml([DsaMatrix(2, 3)], [(0, dsa_words([1] * 6))], promised=1).replace("111\n111", digits, 1)
    with pytest.raises(RecordingCorrupt, match=f"<static_mask> has {len(digits)} digits for 6 cells"):
        open_dsa(packed(tmp_path / "a.dsa", text), None)


def test_what_follows_the_compressed_data_is_ignored(tmp_path: Path) -> None:
    path = write_dsa(tmp_path / "a.dsa", random_scans(10), SMALL)
    path.write_bytes(path.read_bytes() + bytes(200_000))
    reading = open_dsa(path, None).blocks()
    assert drain(reading) == 10
    assert reading.loss is None


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    angle = "<angle><time_stamp>1</time_stamp></angle>"
    text = dsa_xml(SMALL, [(number, dsa_words([1] * 12)) for number in range(50)], promised=50)
    path = packed(tmp_path / "a.dsa", text.replace("</root>", f"<joint_angles>{angle * 50}</joint_angles></root>"))
    assert {element.tag for element in _elements(path)} == {
        "matrix",
        "frame_count",
        "frame",
        "angle",
    }  # all others are dropped


def with_angles(text: str, *rows: str) -> str:
    """A recording with joint angles after its scans."""
    angles = "".join(
        f"<angle><time_stamp>{1000 + 40 * number}</time_stamp><angle_data>{row}</angle_data></angle>"
        for number, row in enumerate(rows)
    )
    return text.replace("</root>", f"<joint_angles>{angles}</joint_angles></root>")


def test_angles_of_the_hands_seven_joints_come_in_degrees(tmp_path: Path) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=1)
    whole = with_angles(text, "0, 10, 20, 30, 40, 50, 60", "90, 10, 20, 30, 40, 50, 180")
    for content in (whole, whole[:-8]):  # the end of the XML is lost
        joints = open_dsa(packed(tmp_path / "a.dsa", content), None).joints
        assert joints is not None
        np.testing.assert_allclose(joints.t_s, [1.0, 1.04])
        found = joints.at(np.array([1.0, 1.04]), ["sdh_knuckle_joint", "sdh_finger_22_joint", "sdh_finger_13_joint"])
        np.testing.assert_allclose(found, np.radians([[0.0, 10.0, 60.0], [90.0, 10.0, 180.0]]))
    for rows in (["1, 2, 3"], ["1, 2, 3, 4, 5, 6, 7, 8"], ["1, 2, 3, 4, 5, 6, 7", "1, 2"]):
        assert open_dsa(packed(tmp_path / "b.dsa", with_angles(text, *rows)), None).joints is None


@pytest.mark.parametrize(("rows", "cols"), [(1024, 1), (1, 1024)])
def test_a_matrix_may_have_1024_rows_or_columns(tmp_path: Path, rows: int, cols: int) -> None:
    recording = open_dsa(write_dsa(tmp_path / "a.dsa", np.ones((1, 1024)), [DsaMatrix(rows, cols)]), None)
    assert [(pad.rows, pad.cols) for pad in recording.sensor.pads] == [(rows, cols)]


@pytest.mark.parametrize(("depth", "allowed"), [(32, True), (33, False)])
def test_xml_is_nested_at_most_32_deep(tmp_path: Path, depth: int, allowed: bool) -> None:
    deep = "<a>" * (depth - 1) + "</a>" * (depth - 1)
    path = packed(tmp_path / "a.dsa", dsa_xml(SMALL, [], promised=0).replace("</root>", deep + "</root>"))
    if allowed:
        assert open_dsa(path, None).scans == 0
    else:
        with pytest.raises(RecordingCorrupt, match="nested more than 32 deep"):
            open_dsa(path, None)


def of_frame(tmp_path: Path, added: str) -> Path:
    """A recording of one scan with something added to its element."""
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=1)
    return packed(tmp_path / "a.dsa", text.replace("</frame>", added + "</frame>"))


@pytest.mark.parametrize(("added", "times"), [(" ", 1 << 20), ("<a/>", 10_000)])
def test_a_scan_takes_at_most_4_mebibytes_in_memory(tmp_path: Path, added: str, times: int) -> None:
    """An element takes a hundred bytes, empty or not."""
    assert len(list(_elements(of_frame(tmp_path, added * (3 * times))))) == 4
    with pytest.raises(ValueError, match="takes more than 4194304 bytes"):
        list(_elements(of_frame(tmp_path, added * (5 * times))))


def test_all_matrices_together_take_at_most_4_mebibytes(tmp_path: Path) -> None:
    text = dsa_xml(SMALL, [], promised=0)
    few, many = (text.replace("</matrix>", " " * spaces + "</matrix>") for spaces in (3 << 19, 5 << 19))
    assert open_dsa(packed(tmp_path / "a.dsa", few), None).scans == 0
    with pytest.raises(RecordingCorrupt, match="its 2 first matrices hold 52"):
        open_dsa(packed(tmp_path / "b.dsa", many), None)


def test_a_hand_has_at_most_1024_matrices(tmp_path: Path) -> None:
    for matrices in (1024, 1025):
        path = packed(tmp_path / "a.dsa", dsa_xml([DsaMatrix(1, 1)] * matrices, [], promised=0))
        if matrices == 1024:
            assert len(open_dsa(path, None).sensor.pads) == 1024
        else:
            with pytest.raises(RecordingCorrupt, match="its 1025 first matrices hold"):
                open_dsa(path, None)


def test_an_element_counts_as_256_bytes_of_what_a_file_unpacks_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "FREE_BYTES", 1_000_000)
    monkeypatch.setattr(limits, "MOST_RATIO", 0)
    text, after = dsa_xml(SMALL, [], promised=0), " " * 200_000  # elements are counted with the next piece, once
    few, many = (text.replace("</root>", "<a/>" * elements + after + "</root>") for elements in (2_500, 5_000))
    assert len(list(_elements(packed(tmp_path / "a.dsa", few)))) == 3
    with pytest.raises(RecordingTooLarge):
        list(_elements(packed(tmp_path / "b.dsa", many)))


@pytest.mark.parametrize("full_scale", ["0", "-1", "nan", "inf"])
def test_an_impossible_full_scale_is_refused_or_taken_as_unknown(tmp_path: Path, full_scale: str) -> None:
    text = dsa_xml(SMALL, [(0, dsa_words([1] * 12))], promised=1)
    path = packed(tmp_path / "a.dsa", text.replace(">4095<", f">{full_scale}<"))
    try:
        assert not open_dsa(path, None).sensor.full_scale
    except RecordingCorrupt as error:
        assert full_scale in str(error)


def test_a_matrix_without_any_cell_does_no_harm_or_is_refused(tmp_path: Path) -> None:
    matrices = [DsaMatrix(2, 3, static="0" * 6), DsaMatrix(3, 2)]
    path = write_dsa(tmp_path / "a.dsa", random_scans(40), matrices)
    try:
        assert len(estimate(path).slips) == 40
    except RecordingError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize(
    "content", [b"", b"plain text", b"BZh9", bz2.compress(b"no xml"), bz2.compress(b""), b"PK\x03\x04"]
)
def test_what_is_no_bzip2_or_no_xml_is_corrupt(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.dsa"
    path.write_bytes(content)
    with pytest.raises(RecordingCorrupt, match=r"a \.dsa recording is bzip2-compressed XML") as caught:
        open_dsa(path, None)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "scans"), mostly_long(SCANS.items(), *list(SCANS.items())[:3]))
def test_a_real_recording_has_the_scans_it_is_known_for(recordings: Path, name: str, scans: int) -> None:
    recording = read(recordings / "sdh-dsa" / f"{name}.dsa")
    assert recording.sensor.name == "schunk-sdh2"
    assert recording.scans == scans
    reading = recording.blocks()
    values = np.concatenate([block.values for block in reading])
    assert reading.loss is None
    assert reading.scans + reading.repeated == scans
    assert values.shape[1] == recording.layout.taxels == 456
    assert 0 <= values.min() < values.max() < 4095


def test_the_real_masked_recording_declares_five_of_six_pads_off(recordings: Path) -> None:
    recording = read(recordings / "sdh-dsa" / "masked_matrix.dsa")
    off = [bool(recording.masked[recording.layout.of_pad(pad)].all()) for pad in range(6)]
    assert off == [True] * 5 + [False]
    assert not recording.masked[recording.layout.of_pad(5)].any()
    assert not read(recordings / "sdh-dsa" / "tennisball.dsa").masked.any()


@pytest.mark.long
@pytest.mark.parametrize(("name", "share"), [("slip_examples_pen_and_wooden_block", 0.75), ("tennisball", 0.5)])
def test_a_real_recording_cut_short_gives_its_beginning(
    recordings: Path, tmp_path: Path, name: str, share: float
) -> None:
    whole = (recordings / "sdh-dsa" / f"{name}.dsa").read_bytes()
    (tmp_path / "cut.dsa").write_bytes(whole[: int(share * len(whole))])
    reading = read(tmp_path / "cut.dsa").blocks()
    count = drain(reading)
    assert 0.2 * SCANS[name] < count < SCANS[name]
    assert f"{count} of {SCANS[name]} scans could be read" in str(reading.loss)


def test_a_real_recording_cut_before_its_first_block_is_corrupt(recordings: Path, tmp_path: Path) -> None:
    whole = (recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa").read_bytes()
    (tmp_path / "cut.dsa").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RecordingCorrupt, match="ends before"):
        read(tmp_path / "cut.dsa")
