from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from rigged import estimated, refused, rigged
from synthetic import grid_sensor
from taxelflow.cli import main
from taxelflow.evaluation.film import gathered
from taxelflow.publish.plots.film import draw_load, film_frames, on_one_plane
from taxelflow.publish.plots.style import VERMILION, styled
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.publish.plots.film import Film, Frame


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stroke")
    save(rigged(), folder / "stroke.npz")
    return estimated(folder / "stroke.npz", folder / "result")


@pytest.fixture(scope="module")
def film(result: Path) -> Film:
    return gathered(result, fps=2.0, speed=1.0, from_s=0.0, to_s=None)


def drawn(film: Film, t_s: float) -> Frame:
    with styled():
        (frame,) = film_frames(film, [t_s])
    return frame


def red(frame: Frame) -> int:
    """Pixels in the colour of a slip's arrow, left of the words and above the load."""
    hand = frame[: int(0.7 * frame.shape[0]), : int(0.7 * frame.shape[1])].astype(int)
    want = [int(VERMILION[place : place + 2], 16) for place in (1, 3, 5)]
    return int((np.abs(hand - want).max(axis=2) < 40).sum())


def test_a_film_holds_the_recording_scan_by_scan(film: Film) -> None:
    assert film.pressure.shape == (137, 162)  # the last frame is at 19.5 s, three scans before the end
    np.testing.assert_allclose(np.diff(film.frames_s), 0.5)
    assert film.frames_s[0] == film.t_s[0] == film.zero_s
    assert film.t_s[-1] <= film.frames_s[-1] < film.t_s[-1] + 1 / 7
    palm = film.layout.pads.index("palm")
    np.testing.assert_allclose(film.load[:, palm], film.pressure[:, film.layout.of_pad(palm)].sum(axis=1), rtol=1e-6)


def test_a_frame_names_pads_and_states_the_scale_of_pressures_and_arrows(film: Film) -> None:
    with styled():
        next(film_frames(film, [6.0]))
        hand, words, *_ = plt.gcf().axes
    assert set(film.layout.pads[: film.layout.pad_count]) <= {text.get_text() for text in hand.texts}
    assert any(text.get_text().endswith(" mm/s") for text in hand.texts)
    assert any(
        text.get_text().startswith("pressure: darkest at 8") and " kPa" in text.get_text() for text in words.texts
    )


def test_pads_that_nothing_touches_have_no_load(film: Film) -> None:
    with styled():
        _, axis = plt.subplots()
        draw_load(axis, film)
    legend = axis.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["palm"]
    plt.close("all")


@pytest.mark.long
def test_pressure_and_arrows_appear_while_the_object_slides(film: Film) -> None:
    slide = float(film.t_s[int(np.flatnonzero(film.slipping.any(axis=1))[12])])
    rest, slip = drawn(film, film.zero_s + 1.0), drawn(film, slide)
    assert slip.shape == rest.shape
    assert slip.shape[0] % 16 == slip.shape[1] % 16 == 0
    assert red(slip) > red(rest) + 50
    assert (slip[..., 0] < 120).sum() > (rest[..., 0] < 120).sum() + 500  # dark blue taxels


def dark(frame: Frame) -> int:
    """Pixels of taxels under load, left of the words and above the load, without the names of the pads."""
    hand = frame[: int(0.6 * frame.shape[0]), : int(0.7 * frame.shape[1])].astype(int)
    return int((hand[..., 2] - hand[..., 0] > 40).sum())


def test_a_part_in_which_nothing_is_touched_looks_idle(film: Film, result: Path) -> None:
    idle = gathered(result, fps=2.0, speed=1.0, from_s=0.0, to_s=1.0)
    assert (idle.darkest, idle.heaviest) == (film.darkest, film.heaviest)
    assert not idle.events
    assert dark(drawn(idle, idle.zero_s + 0.5)) == 0 < dark(drawn(film, film.zero_s + 6.0))


def test_a_recording_in_which_nothing_is_touched_looks_idle(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).normal(0.0, 100.0, (140, 28))
    np.savez(tmp_path / "a.npz", t=np.arange(140) / 20, pressure=noise)
    result = estimated(tmp_path / "a.npz", tmp_path / "result", "--sensor", "grid:4x7@10mm")
    film = gathered(result, fps=2.0, speed=1.0, from_s=0.0, to_s=None)
    assert dark(drawn(film, film.zero_s + 3.0)) == 0
    with styled():
        _, axis = plt.subplots()
        draw_load(axis, film)
    assert axis.get_legend() is None
    plt.close("all")


def test_events_are_reported_when_they_come(film: Film) -> None:
    before, after = (drawn(film, film.events[0].t_s + gap) for gap in (-0.01, 0.01))
    words = np.s_[: int(0.6 * before.shape[0]), int(0.75 * before.shape[1]) :]
    assert (after[words] < 128).sum() > (before[words] < 128).sum() + 100


@pytest.mark.long
def test_a_part_is_filmed_at_its_speed(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = result.parent / "part.gif"
    words = ("--fps", "5", "--speed", "0.5", "--from-s", "5", "--to-s", "6")
    assert main(["film", str(result), str(out), *words]) == 0
    assert capsys.readouterr().out == f"11 frames in {out}\n"
    with Image.open(out) as found:
        assert (found.n_frames, found.info["duration"]) == (11, 200)
    part = gathered(result, fps=5.0, speed=0.5, from_s=5.0, to_s=6.0)
    assert part.t_s[0] <= part.frames_s[0] < part.t_s[1]
    assert {event.pad for event in part.events} <= {"palm", "palm_left", "palm_centre", "palm_right"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--fps", "0"), "fps must be a finite number above 0"),
        (("--speed", "-1"), "speed must be a finite number above 0"),
        (("--from-s", "99"), "--from-s must lie within the recording, 0 to 19.857 s"),
        (("--from-s", "5", "--to-s", "5"), "--to-s must be after from_s, 5 s"),
        (("--fps", "900"), "frames must be at most 3000: choose a part by --from-s and --to-s, or raise --speed"),
    ],
)
def test_a_film_that_cannot_be_is_refused(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert said in refused(capsys, "film", result, tmp_path / "a.gif", *words)
    assert list(tmp_path.iterdir()) == []


def test_without_its_recording_a_result_cannot_be_filmed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(rigged(), tmp_path / "stroke.npz")
    result = estimated(tmp_path / "stroke.npz", tmp_path / "result")
    (tmp_path / "stroke.npz").unlink()
    said = refused(capsys, "film", result, tmp_path / "a.gif")
    assert "stroke.npz, which is gone or has changed; restore it, or run `taxelflow estimate` again" in said


def test_pads_without_a_place_on_the_hand_stand_in_a_row() -> None:
    layout = grid_sensor(4, 7, pads=3).layout
    placed = on_one_plane(layout)
    assert np.isfinite(placed.T_hand).all()
    assert (np.diff(placed.T_hand[:, 0]) > 0.07).all()  # wider than a pad
    assert on_one_plane(placed) is placed


def test_contacts_that_were_split_move_each_on_its_own(tmp_path: Path) -> None:
    save(rigged("two-contacts", motion={"strokes": 1}), tmp_path / "two.npz")
    two = estimated(tmp_path / "two.npz", tmp_path / "result", "--contacts", "2", "--method", "template")
    film = gathered(two, fps=2.0, speed=1.0, from_s=0.0, to_s=None)
    assert film.layout.pads == ("grid", "grid#1", "grid#2")
    assert {event.pad for event in film.events if event.event == "slip_start"} == {"grid#1", "grid#2"}
    assert not film.slipping[:, 0].any()
    while_sliding = film.vectors[(film.t_s > 2.0) & (film.t_s < 3.0)]
    assert np.isnan(while_sliding[:, 0]).all()
    up, down = np.nanmedian(while_sliding[:, 1:, 1], axis=0)
    np.testing.assert_allclose([up, down], [0.012, -0.012], atol=0.002)


def test_one_scan_is_no_film(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "a.npz", t=np.zeros(1), pressure=np.ones((1, 28)))
    result = estimated(tmp_path / "a.npz", tmp_path / "result", "--sensor", "grid:4x7@10mm")
    said = refused(capsys, "film", result, tmp_path / "a.gif")
    assert "scans must be at least 2, at different times, for a film (got 1)" in said
