"""From world boxes to the screen, conservatively.

The eight corners of many boxes are one matrix product (24 × 6) @ (6 × n) of their centers relative to the eye and their
half extents; single precision is enough for it as long as its error stays far below a pixel, and that error is added to
the rectangle in any case. What it leaves unsure is done again in double precision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Rounding of the projection in units of the float format's epsilon times the coordinates' magnitude.
ROUNDING = 16.0

#: Single precision is used while its error, in pixels, stays below this at one unit of depth per unit of size.
SINGLE_PIXELS = 1.0 / 64.0

#: Boxes whose rectangle single precision would grow by more than this, in pixels, are projected in double precision.
REDONE_PIXELS = 1.0 / 16.0

#: Boxes at a time: what the products of that many need stays in the second-level cache.
CHUNK = 8192

_SIGNS = np.array([[1 - 2 * (i & 1), 1 - (i & 2), 1 - (i >> 1 & 2)] for i in range(8)], np.float64)


def box_screen_rectangles(
    boxes: NDArray[np.float64],
    /,
    *,
    axes: NDArray[np.float64],
    eye: NDArray[np.float64],
    window: tuple[float, float, float, float],
    size: tuple[int, int],
    near: float,
    parallel: bool,
    clip: bool = True,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Screen rectangles that enclose the images of boxes.

    A box with a corner in front of the near plane has no finite rectangle: it is flagged as crossing and given the
    whole viewport. So is a box with NaN.

    Parameters
    ----------
    boxes : (6, n) float64
        World centers and half extents.
    axes : (3, 3) float64
        Rows right, up, back.
    eye : (3,) float64
    window : left, right, bottom, top
        Tangents, or world units if `parallel`.
    size : width, height in pixels
    near : float
        Distance of the near plane.
    clip : bool
        Clip rectangles to the viewport.

    Returns
    -------
    rects : (4, n) float64
        x0, y0, x1, y1; y up; a rectangle beyond the viewport is clipped to zero width or height.
    depth : (n,) float64
        Lower bound of the distance along the line of sight.
    crossing : (n,) bool
    """
    left, right, bottom, top = window
    scale = np.array([size[0] / (right - left), size[1] / (top - bottom)])
    start = np.array([left, bottom])
    n = boxes.shape[1]
    rects, depth, crossing = np.empty((4, n)), np.empty(n), np.empty(n, bool)
    # Size in pixels of what one unit of rounding, across or along the line of sight at depth 1, moves a corner by.
    reach = np.abs(scale) * (1.0 + np.abs(start)) if not parallel else np.abs(scale)
    rows = _corner_rows(axes, scale, start, parallel=parallel)
    offset = -scale * start if parallel else None
    single = bool(not parallel and ROUNDING * np.finfo(np.float32).eps * reach.max() < SINGLE_PIXELS and near > 1e-30)
    kind = np.float32 if single else np.float64
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for a in range(0, n, CHUNK):
            part = slice(a, a + CHUNK)
            unsure = _project(
                boxes[:, part], eye, rows, reach, offset, near, kind, rects[:, part], depth[part], crossing[part]
            )
            if single and unsure.any():
                again = np.flatnonzero(unsure)
                r, d, c = np.empty((4, len(again))), np.empty(len(again)), np.empty(len(again), bool)
                _project(boxes[:, a + again], eye, rows, reach, offset, near, np.float64, r, d, c)
                rects[:, a + again], depth[a + again], crossing[a + again] = r, d, c
    if crossing.any():
        rects[:, crossing] = np.array([0.0, 0.0, *size])[:, None]
    if clip:
        np.clip(rects[:2], 0.0, np.array(size, np.float64)[:, None], out=rects[:2])
        np.clip(rects[2:], 0.0, np.array(size, np.float64)[:, None], out=rects[2:])
    return rects, depth, crossing


def _corner_rows(
    axes: NDArray[np.float64], scale: NDArray[np.float64], start: NDArray[np.float64], *, parallel: bool
) -> NDArray[np.float64]:
    """(24, 6) rows: depths of the eight corners, then their x and y in pixels, times the depth in perspective."""
    lines = np.array([-axes[2], scale[0] * axes[0], scale[1] * axes[1]])
    if not parallel:
        # (x / depth - start) * scale as one fraction: no subtraction is left for after the division
        lines[1:] += (scale * start)[:, None] * axes[2]
    rows = np.empty((3, 8, 6))
    rows[:, :, :3] = lines[:, None]
    rows[:, :, 3:] = lines[:, None] * _SIGNS
    return rows.reshape(24, 6)


def _project(
    boxes: NDArray[np.float64],
    eye: NDArray[np.float64],
    rows: NDArray[np.float64],
    reach: NDArray[np.float64],
    offset: NDArray[np.float64] | None,
    near: float,
    kind: type[np.floating],
    rects: NDArray[np.float64],
    depth: NDArray[np.float64],
    crossing: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Fill `rects`, `depth` and `crossing`; return which boxes deserve more precision."""
    eps = float(np.finfo(kind).eps)
    relative = np.empty((6, boxes.shape[1]), kind)
    np.subtract(boxes[:3], eye[:, None], out=relative[:3], casting="same_kind")
    relative[3:] = boxes[3:]
    corners = rows.astype(kind) @ relative
    # Upper bound of the magnitudes that were rounded; those of the world coordinates are at most theirs and the eye's.
    # Half extents are used by magnitude: an inverted box has the same corners.
    np.abs(relative, out=relative)
    slack = relative.sum(axis=0)
    slack *= ROUNDING * eps
    slack += 2 * ROUNDING * np.finfo(np.float64).eps * np.abs(eye).sum()
    w, xy = corners[:8], corners[8:].reshape(2, 8, -1)
    nearest = w.min(axis=0)
    nearest -= slack
    depth[:] = nearest
    if offset is None:
        np.divide(1.0, w, out=w)
        xy *= w
        slack /= nearest
        growth = reach
        # at half the depth the bound of the error says nothing any more
        np.logical_not((nearest > near) & (slack < 0.5), out=crossing)
    else:
        xy += offset[:, None, None].astype(kind)
        growth = reach + ROUNDING * eps * np.abs(offset)
        np.isnan(nearest, out=crossing)
    low, high = xy.min(axis=1), xy.max(axis=1)
    if offset is None:
        # x - slack·(growth + |x|) grows with x, so the lowest corner stays the lowest
        low -= slack * (np.abs(low) + growth[:, None].astype(kind))
        high += slack * (np.abs(high) + growth[:, None].astype(kind))
    else:
        fixed = ROUNDING * eps * np.abs(offset)[:, None]
        low -= slack * growth[:, None] + ROUNDING * eps * np.abs(low) + fixed
        high += slack * growth[:, None] + ROUNDING * eps * np.abs(high) + fixed
    rects[:2], rects[2:] = low, high
    # infinities of opposite sign, or NaN, become NaN; the sum is finite otherwise
    high -= low
    crossing |= ~np.isfinite(high.sum(axis=0))
    if kind is np.float64:
        return np.zeros(0, bool)
    doubtful = slack * growth.max() > REDONE_PIXELS
    # what single precision cannot place on one side of the near plane, or not at all
    return np.asarray((doubtful & (nearest > near)) | (crossing & ~(nearest + 2 * slack * nearest < near)))
