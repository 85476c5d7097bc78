"""Other software that measures the shift between two images: OpenCV, scikit-image, OpenPIV (extra `bench`).

Each gives the motion from one image to the next as (columns to the right, rows downwards), in taxels; NaN without a
result.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.errors import ExtraMissing

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.messages import Floats

    Pair = Callable[[Floats, Floats], tuple[float, float]]

_UPSAMPLED = 8
"""Pixels a taxel in the images for DIS, which cannot work on a few pixels."""
_LEAST = 1e-6
"""Pressure that keeps quotients and weights above 0, far below a reading."""


def peers() -> dict[str, Pair]:
    """All of them by name: cv2.phaseCorrelate, without and with its window, cv2.DISOpticalFlow on enlarged images,
    skimage's phase_cross_correlation, OpenPIV. Raises ExtraMissing.
    """
    cv2 = needed("cv2")
    registration = needed("skimage.registration")
    openpiv = needed("openpiv.pyprocess")
    return {
        "phaseCorrelate": _phase(cv2, windowed=False),
        "phaseCorrelate, Hann": _phase(cv2, windowed=True),
        "DIS flow x8": _inverse_search(cv2),
        "skimage correlation": _cross_correlation(registration.phase_cross_correlation),
        "OpenPIV": _piv(openpiv),
    }


def needed(module: str) -> Any:
    """A module of the extra `bench`. Raises ExtraMissing."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ExtraMissing("bench", module.split(".", maxsplit=1)[0]) from error


def _phase(cv2: Any, *, windowed: bool) -> Pair:
    def pair(before: Floats, after: Floats) -> tuple[float, float]:
        images = before.astype(np.float32), after.astype(np.float32)
        window = (cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F),) if windowed else ()
        (right, down), _ = cv2.phaseCorrelate(*images, *window)
        return right, down

    return pair


def _inverse_search(cv2: Any) -> Pair:
    """Dense optical flow, averaged with the pressure as weight."""
    search = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def pair(before: Floats, after: Floats) -> tuple[float, float]:
        scale = 255 / max(before.max(), after.max(), _LEAST)
        first, second = (
            cv2.resize(
                np.clip(scale * image, 0, 255).astype(np.uint8),
                None,
                fx=_UPSAMPLED,
                fy=_UPSAMPLED,
                interpolation=cv2.INTER_CUBIC,
            )
            for image in (before, after)
        )
        flow = search.calc(first, second, None)
        weight = first.astype(np.float64) + _LEAST
        right, down = (float(np.average(flow[..., axis], weights=weight)) / _UPSAMPLED for axis in (0, 1))
        return right, down

    return pair


def _cross_correlation(phase_cross_correlation: Any) -> Pair:
    """Without normalisation: the high frequencies of so smooth an image are noise."""

    def pair(before: Floats, after: Floats) -> tuple[float, float]:
        shift, _, _ = phase_cross_correlation(before, after, upsample_factor=20, normalization=None)
        return -float(shift[1]), -float(shift[0])

    return pair


def _piv(openpiv: Any) -> Pair:
    """One window over the pad, which is set into a square whose side is a power of two."""

    def pair(before: Floats, after: Floats) -> tuple[float, float]:
        side = 1 << int(np.ceil(np.log2(max(before.shape))))
        first, second = (np.zeros((side, side), dtype=np.float32) for _ in range(2))
        first[: before.shape[0], : before.shape[1]] = before
        second[: after.shape[0], : after.shape[1]] = after
        right, down, _ = openpiv.extended_search_area_piv(
            first,
            second,
            window_size=side,
            overlap=0,
            search_area_size=side,
            sig2noise_method="peak2mean",
            subpixel_method="gaussian",
            normalized_correlation=True,
            correlation_method="linear",
        )
        return float(right[0, 0]), float(down[0, 0])

    return pair
