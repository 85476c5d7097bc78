from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from taxelflow.errors import ExtraMissing, ParameterInvalid
from taxelflow.publish.video import write_video

if TYPE_CHECKING:
    from taxelflow.publish.plots.film import Frame

COLOURS = [(213, 94, 0), (0, 114, 178), (255, 255, 255)]


def frames() -> list[Frame]:
    """Three frames of one colour each."""
    return [np.full((32, 48, 3), colour, dtype=np.uint8) for colour in COLOURS]


def test_a_gif_holds_all_frames_at_their_rate(tmp_path: Path) -> None:
    assert write_video(iter(frames()), tmp_path / "deep" / "a.gif", 20.0) == 3
    with Image.open(tmp_path / "deep" / "a.gif") as film:
        assert (film.n_frames, film.size, film.info["duration"]) == (3, (48, 32), 50)
        for number, colour in enumerate(COLOURS):
            film.seek(number)
            seen = np.asarray(film.convert("RGB"), dtype=float).mean(axis=(0, 1))
            np.testing.assert_allclose(seen, colour, atol=6)
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["a.gif"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_film_on_a_full_disk_is_no_film(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    (tmp_path / "a.mp4.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left on device") as raised:
        write_video(iter(frames()), tmp_path / "a.mp4", 20.0)
    assert raised.value.filename == str(tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio-ffmpeg's reader leaves a pipe
def test_an_mp4_holds_all_frames_at_their_rate(tmp_path: Path) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    assert write_video(iter(frames()), tmp_path / "a.mp4", 20.0) == 3
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    about = next(reader)
    assert (about["size"], about["fps"]) == ((48, 32), 20.0)
    for frame, colour in zip(reader, COLOURS, strict=True):
        seen = np.frombuffer(frame, dtype=np.uint8).reshape(-1, 3).mean(axis=0)
        np.testing.assert_allclose(seen, colour, atol=12)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_a_film_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    def broken() -> object:
        yield frames()[0]
        raise KeyboardInterrupt

    for name in ("a.gif", "a.mp4"):
        with pytest.raises(KeyboardInterrupt):
            write_video(broken(), tmp_path / name, 10.0)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_another_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterInvalid, match=r"out must end in \.gif or \.mp4 \(got '.*a\.avi'\)"):
        write_video(iter(frames()), tmp_path / "a.avi", 10.0)


def test_without_ffmpeg_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ExtraMissing, match=r"pip install 'taxelflow\[video\]'"):
        write_video(iter(frames()), tmp_path / "a.mp4", 10.0)
