from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from rigged import estimated, rigged, strokes_by_both, svg_words
from synthetic import dome, grid_sensor
from taxelflow.errors import ExtraMissing, ResultMissing
from taxelflow.evaluation.plot import gathered, plot_results
from taxelflow.publish import figures
from taxelflow.publish.plots.style import styled
from taxelflow.publish.results import read_result
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from taxelflow.messages import Floats

SIGNATURES = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}
ALONE = ["position-palm", "path-lnorm", "views"]
BOTH = ["position-palm", "path-lnorm", "path-convolution", "views"]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return strokes_by_both(tmp_path_factory.mktemp("stroke"))


@pytest.fixture(scope="module")
def drawn(results: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drawn")
    plot_results(results, out, "svg")
    return out


def saved(path: Path, pressure: Floats, sensor: Sensor) -> Path:
    """A recording at 10 Hz."""
    text = msgspec.json.encode(sensor).decode()
    np.savez(path, t=np.arange(len(pressure)) / 10, pressure=pressure, sensor=text)
    return path


def own_sensor(*names: str) -> Sensor:
    """Pads of 4 x 7 taxels of these names."""
    return Sensor(
        name="own", unit="Pa", pads=tuple(Pad(name=name, rows=4, cols=7, pitch_m=(0.01, 0.01)) for name in names)
    )


def own_result(folder: Path, pressure: Floats) -> Path:
    """The result of a recording of one pad of 4 x 7 taxels."""
    return estimated(saved(folder / "own.npz", pressure, own_sensor("palm")), folder / "own")


def words_of(directories: Sequence[Path]) -> dict[str, list[str]]:
    """Texts of each picture of these results, which is not written to a file."""
    import matplotlib.pyplot as plt
    from matplotlib.text import Text

    found = {}
    with styled():
        for name, figure in figures._figures(gathered(directories)):
            texts = [text.get_text() for text in figure.findobj(Text)]  # type: ignore[attr-defined]
            found[name] = "\n".join(texts).split("\n")
            plt.close(figure)
    return found


# Which pictures


@pytest.mark.long
@pytest.mark.parametrize("form", ["png", "pdf"])
def test_pictures_of_each_form_are_written_whole(results: list[Path], tmp_path: Path, form: str) -> None:
    out = tmp_path / "deep" / "pictures"
    made = plot_results(results[:1], out, form)
    assert made == [out / f"{name}.{form}" for name in ALONE]
    assert sorted(out.iterdir()) == sorted(made)
    for path in made:
        assert path.read_bytes().startswith(SIGNATURES[form])
        assert path.stat().st_size > 5000


@pytest.mark.long
def test_one_result_is_drawn_alone_and_replaces_an_older_drawing(results: list[Path], tmp_path: Path) -> None:
    (tmp_path / "position-palm.svg").write_text("older")
    made = plot_results(results[:1], tmp_path, "svg")
    assert [path.stem for path in made] == ALONE
    assert all(path.read_bytes().startswith(SIGNATURES["svg"]) for path in made)
    words = svg_words(tmp_path / "position-palm.svg")
    assert {"Object on palm", "L norm (Method I)"} <= set(words)
    assert "optical flow (Method II)" not in words


@pytest.mark.long
def test_methods_and_truth_overlay_in_the_position_with_a_line_per_stroke(drawn: Path) -> None:
    words = svg_words(drawn / "position-palm.svg")
    for word in ("Object on palm", "truth", "L norm (Method I)", "optical flow (Method II)", "x in mm", "y in mm"):
        assert word in words
    assert "time in s" in words
    speeds = [float(word.removesuffix(" mm/s")) for word in words if word.endswith(" mm/s")]
    assert len(speeds) == 4
    assert sorted(np.sign(speeds)) == [-1, -1, 1, 1]
    assert all(15 < abs(speed) < 26 for speed in speeds)


def test_the_path_lies_on_its_pad(drawn: Path) -> None:
    for method in ("lnorm", "convolution"):
        words = svg_words(drawn / f"path-{method}.svg")
        for word in ("palm", "x in mm", "y in mm", "time in s"):
            assert word in words


def test_the_views_leave_out_poses_that_are_not_ok(results: list[Path], tmp_path: Path) -> None:
    recording = json.loads((results[0] / "summary.json").read_text())["input"]
    result = estimated(recording, tmp_path / "result", "--method", "template")
    with (result / "slips.csv").open(newline="") as file:
        rows = [*csv.DictReader(file)]
    slipping = [row for row in rows if row["pad"] == "palm" and row["slipping"] == "1"]
    for row in slipping[5:10]:
        row["dx_m"], row["quality"] = "0.09", "unresolved"
    with (result / "slips.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, [*rows[0]], lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    views = gathered([result]).views
    assert views is not None
    assert 2.0 < np.hypot(*views.slip_mm) < 6.0  # 25 mm/s at 7 scans a second


def test_the_views_are_the_papers_three(drawn: Path) -> None:
    words = svg_words(drawn / "views.svg")
    for word in ("pressure in kPa, maximum in magenta", "convolution C[T]", "column", "row"):
        assert word in words
    (slip,) = (word for word in words if word.startswith("slip, "))
    assert 2 < float(slip.split()[1]) < 6  # 25 mm/s at 7 Hz
    (title,) = (word for word in words if word.startswith("palm at "))
    assert 4 < float(title.split()[2]) < 16


@pytest.mark.long
def test_several_pads_share_a_path_and_the_busiest_is_viewed(tmp_path: Path) -> None:
    sensor = grid_sensor(4, 7, pads=6)
    values = np.random.default_rng(0).normal(0, 100, (80, sensor.layout.taxels))
    for pad in range(6):
        for scan in range(20, 30 + 8 * pad):
            values[scan] += dome(sensor, 0.0004 * (scan - 40), pad=pad)
    result = estimated(saved(tmp_path / "a.npz", values, sensor), tmp_path / "a")
    pictures = words_of([result])
    assert [*pictures] == [*(f"position-pad{number}" for number in (5, 4, 3, 2)), "path-convolution", "views"]
    words = pictures["path-convolution"]
    assert {"pad2", "pad3", "pad4", "pad5"} <= set(words)
    assert "pad1" not in words
    assert any(word.startswith("pad5 at ") for word in pictures["views"])


@pytest.mark.long
def test_truth_is_drawn_on_its_own_pad_alone(tmp_path: Path) -> None:
    sensor = grid_sensor(4, 7, pads=2)
    values = np.random.default_rng(0).normal(0, 100, (80, 56))
    x_m = 0.0005 * (np.arange(80) - 50)
    for scan in range(20, 80):
        values[scan] += dome(sensor, x_m[scan]) + dome(sensor, pad=1)
    text, t_s = msgspec.json.encode(sensor).decode(), np.arange(80) / 10
    pose = np.stack([x_m, 0 * x_m, 0 * x_m], axis=1)
    file = tmp_path / "a.npz"
    np.savez(file, t=t_s, pressure=values, sensor=text, truth_pad="pad0", truth_t_s=t_s, truth_pose=pose)
    pictures = words_of([estimated(file, tmp_path / "a")])
    own, other = (pictures[f"position-{pad}"] for pad in ("pad0", "pad1"))
    assert "truth" in own
    assert "truth" not in other
    assert not any(word.endswith(" mm/s") for word in other)


@pytest.mark.long
def test_a_real_slide_is_drawn(recordings: Path, tmp_path: Path) -> None:
    file = recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa"
    pictures = words_of([estimated(file, tmp_path / "a")])
    assert {"position-finger2_distal", "path-convolution", "views"} <= set(pictures)


# The same again


@pytest.mark.long
def test_another_process_gives_the_same_files(results: list[Path], drawn: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "taxelflow.cli", "plot", *map(str, results), "--out", str(tmp_path)]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PYTHONHASHSEED": "7"})
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.svg" for name in BOTH}
    for name in BOTH:
        assert (tmp_path / f"{name}.svg").read_bytes() == (drawn / f"{name}.svg").read_bytes(), name


# What is missing


@pytest.mark.parametrize("name", ["summary.json", "slips.csv"])
@pytest.mark.parametrize("place", [0, 1])
def test_a_result_that_lacks_a_file_is_refused_before_anything_is_drawn(
    results: list[Path], tmp_path: Path, name: str, place: int
) -> None:
    directories = list(results)
    directories[place] = shutil.copytree(results[place], tmp_path / "lacking")
    (tmp_path / "lacking" / name).unlink()
    with pytest.raises(ResultMissing, match=rf"lacking holds no {name}"):
        plot_results(directories, tmp_path / "out", "svg")
    assert not (tmp_path / "out").exists()


def test_rows_without_the_pads_of_the_summary_are_refused(results: list[Path], tmp_path: Path) -> None:
    lacking = shutil.copytree(results[0], tmp_path / "lacking")
    head, *_ = (lacking / "slips.csv").read_text().splitlines(keepends=True)
    (lacking / "slips.csv").write_text(head)
    with pytest.raises(ResultMissing, match="lacking"):
        plot_results([lacking], tmp_path / "out", "svg")


def test_results_of_two_recordings_are_not_drawn_together(results: list[Path], tmp_path: Path) -> None:
    save(rigged("turn", motion={"strokes": 1}), tmp_path / "turn.npz")
    other = estimated(tmp_path / "turn.npz", tmp_path / "turn")
    for directories in ([results[0], other], [*results, other]):
        with pytest.raises(ResultMissing, match=rf"^{other} holds no result .* as {results[0]}; give results of one"):
            plot_results(directories, tmp_path / "out", "svg")
    assert not (tmp_path / "out").exists()


def test_a_result_without_contact_has_nothing_to_draw(tmp_path: Path) -> None:
    idle = own_result(tmp_path, np.random.default_rng(0).normal(0, 100, (50, 28)))
    with pytest.raises(ResultMissing, match=r"no contact at all.*; the result's notes state its readings"):
        plot_results([idle], tmp_path / "out", "svg")
    assert not (tmp_path / "out").exists()


def test_without_its_recording_a_result_has_no_views_and_no_truth(results: list[Path], tmp_path: Path) -> None:
    gone = [shutil.copytree(directory, tmp_path / directory.name) for directory in results]
    for directory in gone:
        summary = json.loads((directory / "summary.json").read_text())
        summary["input"] = str(tmp_path / "gone.npz")
        (directory / "summary.json").write_text(json.dumps(summary))
    pictures = words_of(gone)
    assert [*pictures] == BOTH[:-1]
    words = pictures["position-palm"]
    assert "optical flow (Method II)" in words
    assert "truth" not in words
    assert not any(word.endswith(" mm/s") for word in words)


@pytest.mark.long
@pytest.mark.parametrize("now", ["damaged", "of another sensor", "longer", "later"])
def test_a_recording_that_was_replaced_since_is_not_drawn_as_this_results(
    results: list[Path], tmp_path: Path, now: str
) -> None:
    result = shutil.copytree(results[1], tmp_path / "result")
    summary = json.loads((result / "summary.json").read_text())
    path = shutil.copy(summary["input"], tmp_path / "stroke.npz")
    (result / "summary.json").write_text(json.dumps(summary | {"input": str(path)}))
    assert "views" in words_of([result])
    if now == "damaged":
        path.write_bytes(path.read_bytes()[:5000])
    elif now == "of another sensor":
        save(rigged("turn"), path)
    elif now == "longer":
        save(rigged(motion={"strokes": 4}), path)
    else:
        with np.load(path) as file:
            members = dict(file)
        members["t"], members["truth_t_s"] = members["t"] + 1000, members["truth_t_s"] + 1000
        np.savez(path, **members)
    pictures = words_of([result])
    assert [*pictures] == ["position-palm", "path-convolution"]
    assert "truth" not in pictures["position-palm"]


def test_without_matplotlib_the_extra_is_named(
    results: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ExtraMissing, match=r"pip install 'taxelflow\[plot\]'"):
        plot_results(results, tmp_path / "out", "svg")
    assert not list(tmp_path.rglob("*.svg"))


# What is odd


@pytest.mark.long
def test_no_picture_replaces_another_of_the_same_drawing(results: list[Path], tmp_path: Path) -> None:
    summary = json.loads((results[0] / "summary.json").read_text())
    scaled = estimated(summary["input"], tmp_path / "scaled", "--method", "lnorm", "--gain", "1.2")
    made = plot_results([results[0], scaled], tmp_path / "out", "svg")
    assert len(set(made)) == len(made) == 4


def test_of_contacts_and_their_pad_one_is_drawn(tmp_path: Path) -> None:
    sensor = Sensor(name="own", unit="Pa", pads=tuple(Pad(name, 4, 16, (0.01, 0.01)) for name in ("one", "two")))
    values = np.random.default_rng(0).normal(0, 50, (80, 2, 4, 16))
    row, col = np.mgrid[:4, :16]
    for scan in range(20, 80):
        for pad, middle in ((0, 8.0), (1, 3.0), (1, 12.0)):
            at = middle + 0.02 * (scan - 50)
            values[scan, pad] += 40e3 * np.exp(-((row - 1.5) ** 2 + (col - at) ** 2) / 2)
    recording = saved(tmp_path / "own.npz", values.reshape(80, -1), sensor)
    pictures = words_of([estimated(recording, tmp_path / "own", "--contacts", "2")])
    assert {name for name in pictures if name.startswith("position")} == {
        "position-one",
        "position-two#1",
        "position-two#2",
    }
    assert {"one", "two#1", "two#2"} <= set(pictures["path-convolution"])
    assert not {"two", "one#1"} & set(pictures["path-convolution"])


def test_contacts_that_were_split_have_slip_vectors_instead_of_their_pad(tmp_path: Path) -> None:
    pads = (Pad("one", 4, 16, (0.01, 0.01), origin_m=(0.0, 0.0)), Pad("two", 4, 16, (0.01, 0.01), origin_m=(0.0, 0.1)))
    values = np.random.default_rng(0).normal(0, 50, (120, 2, 4, 16))
    row, col = np.mgrid[:4, :16]
    for scan in range(20, 120):
        for pad, middle in ((0, 8.0), (1, 3.0), (1, 12.0)):
            at = middle + 0.04 * max(scan - 60, 0)
            values[scan, pad] += 40e3 * np.exp(-((row - 1.5) ** 2 + (col - at) ** 2) / 2)
    recording = saved(tmp_path / "own.npz", values.reshape(120, -1), Sensor(name="own", unit="Pa", pads=pads))
    (drawn,) = gathered([estimated(recording, tmp_path / "own", "--contacts", "2", "--method", "template")]).results
    assert drawn.moments
    for moment in drawn.moments:
        seen = {name for name, vector in zip(drawn.layout.pads, moment.vectors, strict=True) if np.isfinite(vector[0])}
        assert seen == {"one", "two#1", "two#2"}


@pytest.mark.long
def test_pads_of_any_name_are_drawn_under_their_name(tmp_path: Path) -> None:
    names = ["left/tip", "läuft ✓ 50 $ (two $)", r"$\nonsense$ <b>&", "../up"]
    sensor = own_sensor(*names)
    values = np.random.default_rng(0).normal(0, 100, (60, sensor.layout.taxels))
    for scan in range(20, 60):
        values[scan] += sum(dome(sensor, 0.0005 * (scan - 40), pad=pad) for pad in range(len(names)))
    result = estimated(saved(tmp_path / "own.npz", values, sensor), tmp_path / "own")
    plot_results([result], tmp_path / "out", "svg")
    pictures = list((tmp_path / "out").iterdir())
    assert len(pictures) == len(names) + 2
    assert not list(tmp_path.rglob("*.part"))
    positions = [svg_words(path) for path in pictures if path.stem.startswith("position-")]
    for name in names:
        assert sum(f"Object on {name}" in words for words in positions) == 1


def test_a_touch_too_short_for_a_position_has_nothing_to_draw(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(0, 50, (60, 28))
    values[30] += dome(grid_sensor(4, 7))
    with pytest.raises(ResultMissing, match=r"no position by .* estimate by another --method, or longer contacts"):
        plot_results([own_result(tmp_path, values)], tmp_path / "out", "svg")


@pytest.mark.long
@pytest.mark.parametrize("scans", [2, 3])
def test_a_touch_too_short_for_a_displacement_is_drawn(tmp_path: Path, scans: int) -> None:
    values = np.random.default_rng(0).normal(0, 50, (60, 28))
    values[30 : 30 + scans] += dome(grid_sensor(4, 7))
    pictures = words_of([own_result(tmp_path, values)])
    assert [*pictures] == ["position-palm", "path-convolution", "views"]
    (title,) = (word for word in pictures["views"] if word.startswith("palm at "))
    assert 3.0 <= float(title.split()[2]) < 3.5  # the scan that is seen is one in contact


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("turn")
    save(rigged("turn-over-hand"), folder / "turn.npz")
    return estimated(folder / "turn.npz", folder / "result")


@pytest.mark.long
def test_the_field_is_drawn_at_moments_when_most_pads_slip(turned: Path) -> None:
    (result,) = gathered([turned]).results
    _, tracks = read_result(turned)
    layout = result.layout
    slipping = np.stack([track.flags["slipping"] for track in tracks], axis=1)[:, layout.independent]
    t_s = tracks[0].numbers["t_s"] - tracks[0].numbers["t_s"][0]
    assert len(result.moments) == 3
    for moment in result.moments:
        k = int(np.argmin(np.abs(t_s - float(moment.title.split()[0]))))
        assert slipping[k].sum() == slipping.sum(axis=1).max()
        assert moment.pressure is not None
        assert moment.pressure.max() > 0
        assert moment.faint is not None
        np.testing.assert_array_equal(~moment.faint[layout.independent], slipping[k])


@pytest.mark.long
def test_moments_of_a_slip_that_hardly_moves_are_not_drawn(turned: Path, tmp_path: Path) -> None:
    """A slip is flagged before the pads move, and a little after."""
    slow = shutil.copytree(turned, tmp_path / "slow")
    rows = list(csv.DictReader((turned / "slips.csv").read_text().splitlines()))
    half_s = float(np.median([float(row["t_s"]) for row in rows if row["slipping"] == "1"]))
    for row in rows:
        for name in ("vx_m_s", "vy_m_s"):
            if row[name] and float(row["t_s"]) < half_s:
                row[name] = str(0.01 * float(row[name]))
    with (slow / "slips.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    whole, halved = (gathered([folder]).results[0].moments for folder in (turned, slow))
    first_s = float(rows[0]["t_s"])
    drawn_s = [[first_s + float(moment.title.split()[0]) for moment in moments] for moments in (whole, halved)]
    assert min(drawn_s[0]) < half_s
    assert drawn_s[1]
    assert min(drawn_s[1]) >= half_s - 1e-2


def test_where_no_pad_slips_there_is_no_field(turned: Path, tmp_path: Path) -> None:
    still = shutil.copytree(turned, tmp_path / "still")
    rows = list(csv.DictReader((turned / "slips.csv").read_text().splitlines()))
    with (still / "slips.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(row | {"slipping": "0"} for row in rows)
    (result,) = gathered([still]).results
    assert not result.moments  # and so no picture of it, as of the stroke


@pytest.mark.long
def test_an_object_over_several_pads_is_drawn_as_a_field(turned: Path) -> None:
    words = words_of([turned])["field-convolution"]
    turns = [float(word.split()[-2]) for word in words if word.startswith("estimated: ")]
    assert len(turns) == 3
    assert any(0.4 < abs(turn) < 0.6 for turn in turns)  # it turns at 0.5 rad/s, and rests between
