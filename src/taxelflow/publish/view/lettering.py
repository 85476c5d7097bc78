"""Labels and pictures in the scene: planes that face the camera, in the colours of the theme.

Labels of viser are black on white boxes in every theme. The font is the one that Pillow holds.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.publish.view.look import NAMES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats
    from taxelflow.publish.view.camera import Axes
    from taxelflow.publish.view.palette import Rgb


class Anchor(NamedTuple):
    """The point of a plane that is placed: 0 to 1 from its left to its right, and from its bottom to its top."""

    x: float
    y: float


TOP, LEFT, RIGHT = Anchor(0.5, 1.0), Anchor(0.0, 0.5), Anchor(1.0, 0.5)


@cache
def font() -> Any:
    """Pillow's font at the size of letters."""
    from PIL import ImageFont

    return ImageFont.load_default(NAMES.em)


def text_image(words: str, colour: Rgb) -> NDArray[np.uint8]:
    """(height, width, 4), a transparent image of text."""
    from PIL import Image, ImageDraw

    own = font()
    ascent, descent = own.getmetrics()
    wide = int(np.ceil(own.getlength(words or " "))) + 2 * NAMES.edge
    image = Image.new("RGBA", (wide, ascent + descent + 2 * NAMES.edge), (*colour, 0))  # of one colour up to the edges
    ImageDraw.Draw(image).text((NAMES.edge, NAMES.edge), words, fill=(*colour, 255), font=own)
    return np.asarray(image)


class Plane:
    """A picture in the scene, of pixels of any size."""

    def __init__(self, server: Any, name: str) -> None:
        self._server, self._name = server, name
        self._handle: Any = None
        self._spot: tuple[Floats, Axes, Anchor, float] | None = None

    def draw(self, image: NDArray[np.uint8]) -> None:
        """Show another picture (height, width, 4)."""
        high, wide = (float(pixels) for pixels in image.shape[:2])
        if self._handle is None:
            add = self._server.scene.add_image
            self._handle = add(self._name, image, wide, high, format="png", cast_shadow=False, receive_shadow=False)
        else:
            self._handle.image, self._handle.render_width, self._handle.render_height = image, wide, high
        self._put()

    def move(self, place: Floats, axes: Axes, anchor: Anchor, pixel_m: float) -> None:
        """Put its anchor at a place (3,), in a picture with these axes."""
        self._spot = place, axes, anchor, pixel_m
        self._put()

    def _put(self) -> None:
        if self._handle is None or self._spot is None:
            return
        handle, (place, axes, anchor, pixel_m) = self._handle, self._spot
        off = (0.5 - anchor.x) * handle.render_width * axes.right + (0.5 - anchor.y) * handle.render_height * axes.up
        handle.scale, handle.position, handle.wxyz = pixel_m, place + pixel_m * off, axes.wxyz


class Label(Plane):
    """One line of text."""

    def __init__(self, server: Any, name: str, words: str) -> None:
        super().__init__(server, name)
        self.words = words
        self._written: tuple[str, Rgb] | None = None

    def tint(self, colour: Rgb) -> None:
        """Write them in a colour."""
        if self._written != (self.words, colour):
            self._written = self.words, colour
            self.draw(text_image(self.words, colour))
