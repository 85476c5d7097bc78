"""Scans drawn as text, for tests of contact segmentation: a row of characters per row of taxels.

A digit d reads 10 d standard deviations of noise, `e` reads 5 (loaded, but too faint to start a contact), `.` reads 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from synthetic import grid_sensor, scans_of
from taxelflow.contacts.segmentation import ContactTracker, Segmentation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Floats, Scans
    from taxelflow.sensors.layout import Layout

LEVELS = {".": 0.0, "e": 5.0} | {str(digit): 10.0 * digit for digit in range(10)}
LABELS = {0: ".", 1: "1", 2: "2", 3: "3", -1: "a", -2: "b", -3: "c"}
"""Loaded taxels of contacts by number; unloaded ones beside them by letter."""


def reading(image: str) -> Floats:
    """(taxels,) of an image with rows separated by spaces."""
    return np.array([LEVELS[character] for character in image.replace(" ", "")])


def drawn(images: Sequence[str], **more: Any) -> Scans:
    """Scans of a pad of the images' size, one a scan."""
    rows = images[0].split()
    sensor = grid_sensor(len(rows), len(rows[0]))
    return scans_of(sensor, np.array([reading(image) for image in images]), **{"noise": 1.0, **more})


def layout_of(image: str) -> Layout:
    rows = image.split()
    return grid_sensor(len(rows), len(rows[0])).layout


def segmented(*images: str, slots: int = 2, **more: Any) -> Segmentation:
    """Contacts tracked over these images."""
    tracker = ContactTracker(layout_of(images[0]), np.array([0]), np.array([slots]), 6.0, 4.0)
    return tracker.step(drawn(images, **more))


def labels(*images: str, slots: int = 2, beside: bool = False, **more: Any) -> list[str]:
    """Labels of each image, drawn like it; those of unloaded taxels only if `beside` is set."""
    cols = len(images[0].split()[0])
    found = segmented(*images, slots=slots, **more).labels
    texts = ["".join(LABELS[int(label)] if label > 0 or beside else "." for label in scan) for scan in found]
    return [" ".join(text[start : start + cols] for start in range(0, len(text), cols)) for text in texts]
