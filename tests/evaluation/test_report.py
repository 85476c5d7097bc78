from __future__ import annotations

import json
import re
import shutil
import sys
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

from browsed import installed_browser
from rigged import estimated, refused, rigged, strokes_by_both
from synthetic import dome
from taxelflow.cli import main
from taxelflow.errors import ExtraMissing
from taxelflow.evaluation.report import make_report
from taxelflow.publish.results import read_summary
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("jinja2")
OWN = re.compile(r"<script type=\"application/json\" id=\"numbers\">(.*?)</script>", re.DOTALL)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return strokes_by_both(tmp_path_factory.mktemp("stroke"))


@pytest.fixture(scope="module")
def page(results: list[Path]) -> str:
    out = results[0].parent / "report.html"
    make_report(results, out)
    return out.read_text()


def charts(page: str) -> list[dict[str, Any]]:
    (found,) = OWN.findall(page)
    sections: list[dict[str, Any]] = json.loads(found)
    return sections


def cells(page: str) -> list[str]:
    return re.findall(r"<td>(.*?)</td>", page)


@pytest.mark.long
def test_methods_of_one_recording_stand_side_by_side(page: str) -> None:
    (recording,) = charts(page)
    assert [result["label"] for result in recording["results"]] == [
        "L norm (Method I)", "optical flow (Method II)", "truth",
    ]  # fmt: skip
    assert recording["pads"][0] == "palm"
    assert recording["duration_s"] == pytest.approx(139 / 7, abs=0.01)
    assert cells(page).count("optical flow (Method II)") >= 2
    assert "<h2>stroke.npz</h2>" in page


def test_numbers_of_slips_are_those_of_the_summary(page: str, results: list[Path]) -> None:
    """Terminal, events.csv and report tell one path, that of the fit."""
    from taxelflow.publish.results import read_result

    for result in results:
        ran, _ = read_result(result)
        palm = [contact for contact in ran.contacts if contact.pad == "palm"]
        path_mm = sum(1e3 * contact.path_m for contact in palm if contact.path_m is not None)
        seen = [f"{path_mm:.1f}", f"{sum(contact.slip_s for contact in palm):.2f}"]
        assert path_mm > 0
        assert seen[0] in cells(page)
        assert seen[1] in cells(page)
    titles = [scan["title"] for scan in charts(page)[0]["scans"]]
    assert any(re.search(r"palm slips [\d.]+ mm in [\d.]+ s by L norm", title) for title in titles)


def test_lanes_hold_the_contacts_and_slips_of_the_result(page: str, results: list[Path]) -> None:
    from taxelflow.numerics.spans import spans
    from taxelflow.publish.results import read_result

    lanes = charts(page)[0]["results"][1]["lanes"]["palm"]
    ran, tracks = read_result(results[1])
    (palm,) = (track for track in tracks if track.pad == "palm")
    t_s = palm.numbers["t_s"] - ran.t_first_s
    for kind, flag in (("contact", "contact"), ("slip", "slipping")):
        want = [[t_s[first], t_s[stop - 1]] for first, stop in spans(palm.flags[flag])]
        np.testing.assert_allclose(lanes[kind], want, atol=1e-3)
    assert len(lanes["contact"]) == 2


def test_key_scans_are_those_of_slips_and_of_the_largest_load(page: str) -> None:
    scans = charts(page)[0]["scans"]
    times = [scan["t_s"] for scan in scans]
    assert times == sorted(times)
    assert sum("largest load" in scan["title"] for scan in scans) == 1
    assert all(max(scan["shades"]) == 99 and len(scan["shades"]) == 162 for scan in scans)
    slipping = charts(page)[0]["results"][0]["lanes"]["palm"]["slip"]
    for scan in scans:
        if "slips" in scan["title"]:
            assert any(first <= scan["t_s"] <= last for first, last in slipping)


def test_arrows_of_all_key_scans_have_one_scale(page: str) -> None:
    scans = [scan for scan in charts(page)[0]["scans"] if scan["arrows"]]
    drawn = [max(float(np.hypot(*arrow[2:4])) for arrow in scan["arrows"]) for scan in scans]
    speeds = [float(re.findall(r"longest arrow ([\d.]+) mm/s", scan["title"])[0]) for scan in scans]
    usual = drawn[0] / speeds[0] * float(np.median(speeds))
    assert len(set(speeds)) > 1
    np.testing.assert_allclose(drawn, np.minimum(np.array(speeds) / np.median(speeds), 2.0) * usual, rtol=0.01)


def test_the_sensor_is_checked_up(page: str) -> None:
    health = charts(page)[0]["health"]
    assert len(health["shades"]) == len(health["marks"]) == 162
    assert set(health["marks"]) <= set("o.!xF")
    assert "never loaded" in page


def test_parameters_that_differ_are_marked(page: str) -> None:
    marked = re.findall(r"<tr class=\"marked\"><td>([\w.]+)</td>", page)
    assert "method" in marked
    assert "condition.contact_on" not in marked
    assert "condition.contact_on" in cells(page)


def test_nothing_is_loaded_from_elsewhere(page: str) -> None:
    assert not re.search(r"\b(src|href)\s*=", OWN.sub("", page).split("<script>")[0])
    assert "default-src 'none'" in page
    addresses = set(re.findall(r"https?://[\w./-]+", page))
    assert addresses <= {"https://github.com/leeoniya/uPlot", "http://www.w3.org/2000/svg"}
    assert len(page) < 5e6


@pytest.mark.long
def test_recordings_follow_each_other(results: list[Path], tmp_path: Path) -> None:
    save(rigged("turn"), tmp_path / "turn.npz")
    other = estimated(tmp_path / "turn.npz", tmp_path / "turn")
    assert main(["report", str(results[1]), str(other), "--out", str(tmp_path / "both.html")]) == 0
    page = (tmp_path / "both.html").read_text()
    assert len(charts(page)) == 2
    assert "<h1>2 recordings</h1>" in page
    assert page.index("<h2>stroke.npz</h2>") < page.index("<h2>turn.npz</h2>")


def test_two_results_of_one_method_have_distinct_labels(results: list[Path], tmp_path: Path) -> None:
    second = shutil.copytree(results[1], tmp_path / "again")
    make_report([results[1], second], tmp_path / "a.html")
    found = charts((tmp_path / "a.html").read_text())[0]["results"]
    labels, colours = [one["label"] for one in found], [one["colour"] for one in found]
    assert labels[:2] == ["optical flow (Method II), convolution", "optical flow (Method II), again"]
    assert len(set(colours)) == 3


def test_without_its_recording_a_report_states_it(results: list[Path], tmp_path: Path) -> None:
    gone = shutil.copytree(results[0], tmp_path / "gone")
    summary = json.loads((gone / "summary.json").read_text())
    summary["input"] = str(tmp_path / "gone.npz")
    (gone / "summary.json").write_text(json.dumps(summary))
    make_report([gone], tmp_path / "a.html")
    (recording,) = charts((tmp_path / "a.html").read_text())
    assert recording["scans"] == []
    assert recording["no_scans"].startswith("The recording is gone")
    assert recording["health"] is None
    assert "truth" not in [result["label"] for result in recording["results"]]


def test_names_cannot_break_the_page(tmp_path: Path) -> None:
    hostile = "</script><b>&'"
    pads = (Pad(name=hostile, rows=4, cols=7, pitch_m=(0.01, 0.01)),)
    sensor = Sensor(name="<i>own", unit="Pa", pads=pads)
    values = np.random.default_rng(0).normal(0, 100, (60, 28))
    for scan in range(20, 60):
        values[scan] += dome(sensor, 0.0005 * (scan - 40))
    np.savez(tmp_path / "a.npz", t=np.arange(60) / 10, pressure=values, sensor=msgspec.json.encode(sensor).decode())
    make_report([estimated(tmp_path / "a.npz", tmp_path / "a")], tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text()
    assert charts(page)[0]["pads"] == [hostile]
    assert page.count("</script>") == 3
    assert hostile not in page
    assert "<i>own" not in page


@pytest.fixture
def untouched(tmp_path: Path) -> Path:
    sensor = Sensor(name="own", unit="Pa", pads=(Pad(name="pad", rows=4, cols=7, pitch_m=(0.01, 0.01)),))
    values = np.random.default_rng(0).normal(0, 100, (60, 28))
    np.savez(tmp_path / "a.npz", t=np.arange(60) / 10, pressure=values, sensor=msgspec.json.encode(sensor).decode())
    make_report([estimated(tmp_path / "a.npz", tmp_path / "a")], tmp_path / "a.html")
    return tmp_path / "a.html"


def test_a_recording_without_contact_has_a_report(untouched: Path) -> None:
    (recording,) = charts(untouched.read_text())
    assert recording["results"] == recording["scans"] == []
    assert recording["no_scans"] == "No pad was touched."


def test_a_browser_draws_the_report_of_a_recording_without_contact(untouched: Path) -> None:
    executable = installed_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        errors: list[str] = []
        tab = browser.new_page()
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(untouched.as_uri())
        ready = tab.wait_for_function("document.body.dataset.ready || null", timeout=5000)
        assert ready.json_value() == "yes"
        browser.close()
    assert not errors


@pytest.mark.long
def test_real_slips_make_a_report(recordings: Path, tmp_path: Path) -> None:
    file = recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa"
    make_report([estimated(file, tmp_path / "a")], tmp_path / "a.html")
    (recording,) = charts((tmp_path / "a.html").read_text())
    assert recording["pads"][0] == "finger2_distal"
    assert recording["results"][0]["lanes"]["finger2_distal"]["slip"]
    assert recording["scans"]


def test_what_cannot_be_reported_is_refused(
    results: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a.html"
    assert "holds no summary.json" in refused(capsys, "report", tmp_path, "--out", out)
    assert "results must name at least one directory" in refused(capsys, "report", "--out", out)
    assert "out must end in .html" in refused(capsys, "report", results[0], "--out", tmp_path / "a.pdf")
    assert list(tmp_path.iterdir()) == []


def test_without_jinja2_the_extra_is_named(
    results: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ExtraMissing, match=r"pip install 'taxelflow\[report\]'"):
        make_report(results[:1], tmp_path / "a.html")
    assert list(tmp_path.iterdir()) == []


def test_contacts_that_were_split_count_instead_of_their_pad(tmp_path: Path) -> None:
    save(rigged("two-contacts"), tmp_path / "two.npz")
    two = estimated(tmp_path / "two.npz", tmp_path / "result", "--contacts", "2", "--method", "template")
    make_report([two], tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    contacts, _, path_mm, _, speed = cells(page)[5:10]
    parts = [contact for contact in read_summary(two).contacts if contact.pad != "grid"]
    assert contacts == str(len(parts)) == "2"
    assert path_mm == f"{sum(1e3 * (part.path_m or 0.0) for part in parts):.1f}"
    assert float(speed) == pytest.approx(12.0, abs=0.1)  # each slides at that speed; their common load does not
    scans = [scan for scan in charts(page)[0]["scans"] if "slips" in scan["title"]]
    assert all("grid#" in scan["title"] for scan in scans)
    assert all(len(scan["arrows"]) == 2 for scan in scans)


def test_slips_without_a_path_have_none_in_the_table(tmp_path: Path) -> None:
    save(rigged("two-contacts"), tmp_path / "two.npz")
    make_report([estimated(tmp_path / "two.npz", tmp_path / "result", "--method", "sum")], tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    slips, *moved = cells(page)[6:10]
    assert int(slips) > 0
    assert moved == ["-", "-", "-"]
    assert "bands of one standard deviation where they are ok" in page
