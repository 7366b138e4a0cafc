"""How wrong a culled frame is: set metrics, image metrics, and what a path makes of them.

Plain functions on arrays. Set metrics follow Nirenstein, Blake and Gain 2002 (exact, conservative,
aggressive, approximate) and the two ratios of Bittner's thesis: what is kept though invisible, and what is
hidden though visible, over what is visible. Image metrics compare a frame with the one that hides nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

Rows = NDArray[np.bool_]
Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

# Chen et al. 2003, section 4.1: the weights of ITU-R BT.601.
LUMINANCE = (0.299, 0.587, 0.114)
# Wang et al. 2004, section III-C: an 11 x 11 Gaussian window, and the two stabilizing constants.
SSIM_SIGMA, SSIM_RADIUS = 1.5, 5
SSIM_C1, SSIM_C2 = (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2


# Sets of drawables


def false_hides(exact: Rows, kept: Rows) -> int:
    """Drawables that are visible in truth and were hidden.

    Parameters
    ----------
    exact, kept : (n,) bool
        The exact visible set, and what the pipeline left.
    """
    return int(np.count_nonzero(exact & ~kept))


def missing_pixels(pixels: ArrayLike, kept: Rows) -> float:
    """Pixels of the image that belong to hidden drawables.

    Parameters
    ----------
    pixels : (n,) number
        Pixels in which each drawable is the nearest, from the item buffer. For a supersampled item buffer,
        divide by the samples per pixel first: the answer has the unit of this argument.
    kept : (n,) bool
    """
    return float(np.asarray(pixels, float)[~kept].sum())


def overestimate(exact: Rows, kept: Rows) -> int:
    """Drawables that were kept although nothing of them can be seen."""
    return int(np.count_nonzero(kept & ~exact))


def level_pops(
    before: NDArray[Any],
    after: NDArray[Any],
    drawn_before: Rows | None = None,
    drawn_after: Rows | None = None,
) -> int:
    """Drawables whose level of detail changed between two frames that both draw them.

    Parameters
    ----------
    before, after : (n,) int
        Level of each drawable, 0 finest.
    drawn_before, drawn_after : (n,) bool, optional
        A drawable that only one of the frames draws does not pop; it appears or disappears.
    """
    changed = np.asarray(before) != np.asarray(after)
    for drawn in (drawn_before, drawn_after):
        if drawn is not None:
            changed = changed & drawn
    return int(np.count_nonzero(changed))


def longest_streak(missing: Iterable[Rows]) -> int:
    """Longest run of consecutive frames in which one and the same drawable is falsely hidden.

    Parameters
    ----------
    missing : iterable of (n,) bool
        Per frame of one path, in order: visible in truth and hidden.
    """
    run: NDArray[np.int64] | None = None
    longest = 0
    for rows in missing:
        run = np.zeros(rows.shape, np.int64) if run is None else run
        run = (run + 1) * rows
        longest = max(longest, int(run.max(initial=0)))
    return longest


# Images


def luminance(image: Image) -> Floats:
    """(h, w) luminance, 0 to 255, of an (h, w, 3) image."""
    weighted: Floats = np.asarray(image)[..., :3] @ np.asarray(LUMINANCE)
    return weighted


def wrong_pixels(image: Image, reference: Image) -> int:
    """Pixels that differ from the reference in any channel."""
    _same_size(image, reference)
    return int(np.count_nonzero((image != reference).any(-1)))


def snr_db(image: Image, reference: Image) -> float:
    """Signal-to-noise ratio on luminance, in dB (Chen et al. 2003, section 4.1).

    `10 log10(sum f^2 / sum (f - r)^2)` with f the luminance of the approximated image and r that of the
    reference. The signal is the approximated image, as printed.

    Returns
    -------
    float
        +inf when the luminances are equal; -inf for an all-black image of something that is not.
    """
    _same_size(image, reference)
    signal, noise = luminance(image), luminance(image) - luminance(reference)
    return _decibel(float(np.vdot(signal, signal)), float(np.vdot(noise, noise)))


def psnr_db(image: Image, reference: Image) -> float:
    """Peak signal-to-noise ratio over the three color channels, in dB; +inf for equal images."""
    _same_size(image, reference)
    noise = image[..., :3].astype(float) - reference[..., :3].astype(float)
    return _decibel(255.0**2, float(np.vdot(noise, noise)) / max(noise.size, 1))


def ssim(image: Image, reference: Image) -> float:
    """Mean structural similarity of the luminances, at most 1.

    Wang, Bovik, Sheikh and Simoncelli 2004, eq. 13: Gaussian window of 11 x 11 pixels with sigma 1.5,
    K1 = 0.01, K2 = 0.03, L = 255. As in the authors' program only windows that lie wholly inside the image
    count; an image smaller than the window is mirrored at its border instead.
    """
    _same_size(image, reference)
    x, y = luminance(image), luminance(reference)
    mean_x, mean_y = _window(x), _window(y)
    # Rounding can make the variance of a flat patch slightly negative.
    var_x = np.maximum(_window(x * x) - mean_x**2, 0.0)
    var_y = np.maximum(_window(y * y) - mean_y**2, 0.0)
    covariance = _window(x * y) - mean_x * mean_y
    similarity = ((2 * mean_x * mean_y + SSIM_C1) * (2 * covariance + SSIM_C2)) / (
        (mean_x**2 + mean_y**2 + SSIM_C1) * (var_x + var_y + SSIM_C2)
    )
    r = SSIM_RADIUS
    inner = similarity[r:-r, r:-r] if min(similarity.shape) > 2 * r else similarity
    return float(inner.mean())


def _window(values: Floats) -> Floats:
    smooth: Floats = ndimage.gaussian_filter(values, SSIM_SIGMA, radius=SSIM_RADIUS)
    return smooth


def _decibel(signal: float, noise: float) -> float:
    if noise == 0.0:
        return float("inf")
    return float(10.0 * np.log10(signal / noise)) if signal > 0.0 else float("-inf")


def _same_size(image: Image, reference: Image) -> None:
    if image.shape[:2] != reference.shape[:2]:
        raise ValueError(f"images of different size: {image.shape[:2]} and {reference.shape[:2]}")


# Along a path


@dataclass(frozen=True)
class Spread:
    """What a path makes of one number per frame; NaN throughout for a path without frames."""

    mean: float
    median: float
    low: float
    """First quartile."""
    high: float
    """Third quartile."""
    p95: float
    worst: float

    def to_dict(self) -> dict[str, float]:
        """Return the fields by name."""
        return asdict(self)


def spread(values: Sequence[float]) -> Spread:
    """Summarize a quantity of which less is better: p95 is the 95th percentile and worst the maximum."""
    if not len(values):
        return Spread(*[float("nan")] * 6)
    array = np.asarray(values, float)
    low, median, high, p95 = (float(v) for v in np.quantile(array, (0.25, 0.5, 0.75, 0.95)))
    return Spread(float(array.mean()), median, low, high, p95, float(array.max()))


@dataclass(frozen=True)
class Decibels:
    """Decibels along a path. A frame equal to its reference has +inf dB and is counted, never averaged."""

    mean_of_finite: float | None
    """Mean over the frames that differ; None when none does."""
    equal_frames: int
    """Frames at +inf dB."""
    p5: float
    """95 % of the frames are at least this good."""
    minimum: float
    """The worst frame; +inf when every frame equals its reference."""

    def to_dict(self) -> dict[str, float | int | None]:
        """Return the fields by name."""
        return asdict(self)


def decibels(values: Sequence[float]) -> Decibels:
    """Summarize decibels, of which more is better and of which some may be infinite."""
    array = np.asarray(values, float)
    if not array.size:
        return Decibels(None, 0, float("nan"), float("nan"))
    finite = array[np.isfinite(array)]
    # The lower of two neighbors, since a quantile between a number and +inf is not one.
    p5 = float(np.quantile(array, 0.05, method="lower"))
    mean = float(finite.mean()) if finite.size else None
    return Decibels(mean, int(np.count_nonzero(array == np.inf)), p5, float(array.min()))


def window_sums(values: Sequence[float], size: int) -> Floats:
    """Sums over all runs of `size` consecutive values; over all of them if there are fewer."""
    array = np.asarray(values, float)
    total = np.concatenate([[0.0], np.cumsum(array)])
    size = min(max(size, 1), len(array))
    return np.asarray(total[size:] - total[:-size]) if len(array) else np.zeros(0)


def share(part: float, whole: float) -> float:
    """Part over whole; 0 of nothing is 0, and something of nothing is +inf."""
    if whole:
        return part / whole
    return 0.0 if part == 0 else float("inf")
