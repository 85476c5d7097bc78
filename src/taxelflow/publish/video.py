"""Frames as a film: GIF by Pillow, MP4 (H.264) by the ffmpeg that the extra `video` brings."""

from __future__ import annotations

import errno
import os
import subprocess
from contextlib import suppress
from itertools import chain
from typing import IO, TYPE_CHECKING, cast

from taxelflow.errors import ExtraMissing, ParameterInvalid
from taxelflow.runtime.whole_file import whole_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from taxelflow.publish.plots.film import Frame

SUFFIXES = (".gif", ".mp4")
_CRF = "15"
"""Quality of H.264: thin lines blur above."""


def check_video(path: Path, option: str = "out") -> None:
    """Refuse a film that could not be written, before the work begins. Raises ParameterInvalid, ExtraMissing.

    option: name of the path in the error.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ParameterInvalid(option, str(path), f"end in {' or '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mp4":
        try:
            import imageio_ffmpeg  # noqa: F401  # only whether it is there
        except ImportError as error:
            raise ExtraMissing("video", "imageio-ffmpeg") from error


def write_video(frames: Iterable[Frame], path: Path, fps: float) -> int:
    """Write frames of one size, whole or not at all; return how many. Raises ParameterInvalid, ExtraMissing."""
    check_video(path)
    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    with whole_file(path) as part:
        return write(frames, part, fps)


def _write_gif(frames: Iterable[Frame], path: Path, fps: float) -> int:
    """All frames share the palette of the first one that has them: a film of one look needs no other."""
    from PIL import Image

    images = (Image.fromarray(frame) for frame in frames)
    kept = list(images)
    sample = Image.new("RGB", (kept[0].width, 3 * kept[0].height))
    for place, number in enumerate((0, len(kept) // 2, len(kept) - 1)):
        sample.paste(kept[number], (0, place * kept[0].height))
    palette = sample.quantize(256)  # as many as a GIF has
    reduced = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in kept]
    reduced[0].save(
        path, format="GIF", save_all=True, append_images=reduced[1:], duration=round(1000 / fps), loop=0, optimize=False
    )
    return len(reduced)


def _write_mp4(frames: Iterable[Frame], path: Path, fps: float) -> int:
    """Raises OSError where ffmpeg ends with an error: imageio_ffmpeg's own writer leaves a broken file then."""
    import imageio_ffmpeg

    incoming = iter(frames)
    first = next(incoming)
    height, width = first.shape[:2]
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-")
    made = ("-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-crf", _CRF, "-f", "mp4")
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "quiet", *raw, *made, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True) as ffmpeg:  # Ctrl-C is for us
        try:
            count = _fed(chain([first], incoming), cast("IO[bytes]", ffmpeg.stdin))
        except BaseException:
            ffmpeg.kill()
            raise
    if ffmpeg.returncode:
        number = 256 - ffmpeg.returncode  # it returns the system's, negative
        number = number if number in errno.errorcode else errno.EIO
        raise OSError(number, os.strerror(number))
    return count


def _fed(frames: Iterable[Frame], pipe: IO[bytes]) -> int:
    """Write frames to ffmpeg until it has enough; how many."""
    count = 0
    with suppress(BrokenPipeError), pipe:
        for frame in frames:
            pipe.write(frame.tobytes())
            count += 1
    return count
