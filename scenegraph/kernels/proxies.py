"""Boxes as what a rasterizer gets instead of the things in them: corners in clip space, grown by a stated bound.

A rasterizer decides by samples, and rounds. What lies in a box is drawn in single precision and its corners are snapped
to a grid of subpixels; so are the box's. For the box to cover every sample that its contents cover, and nowhere farther
away, it is grown by

* twice the largest shift of a corner by snapping, `step` pixels each, at the depth of the box's farthest corner: an
  eye-space ball of that radius projects to at least that many pixels wherever in the box it lies, and a convex hull
  whose corners move by no more than `step` still holds everything farther than `step` from its border;
* the rounding of the contents' own coordinates, 2.5 units of single precision times their magnitude for each coordinate
  of clip space (four products, three sums and a rounded matrix), with a factor for the division by w;
* the same in depth, relative to the nearest corner, because z and w are rounded independently; and a few units of
  single precision for the division and the interpolation.

Everything is worked out in double precision relative to the eye and rounded once, at the end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_EPS32 = float(np.finfo(np.float32).eps)
_EPS64 = float(np.finfo(np.float64).eps)
_LARGEST = float(np.finfo(np.float32).max)

#: Depth, in half depth ranges, by which a box comes nearer for the rounding of z / w and of its interpolation.
DEPTH_BIAS = 2.0**-20

#: Rounding of one coordinate of clip space in units of single precision times the magnitude of what was added up.
ROUNDING = 3.0

#: Boxes at a time: what the product of that many needs stays in the second-level cache.
CHUNK = 2048

#: (3, 8) signs of the corners; corner i has bit 0 of i for x, bit 1 for y, bit 2 for z.
CORNER_SIGNS = np.array([[2 * (i >> axis & 1) - 1 for i in range(8)] for axis in range(3)], np.float64)

#: (36,) corners of the twelve triangles of a box, counterclockwise seen from outside.
TRIANGLES = np.array(
    [0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6],
    np.uint32,
)


def box_clip_corners(
    boxes: NDArray[np.float64],
    /,
    *,
    axes: NDArray[np.float64],
    eye: NDArray[np.float64],
    projection: NDArray[np.float64],
    pixels: tuple[float, float],
    step: float,
    margin: float = 0.0,
    reach: float,
    near: float,
    parallel: bool,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Corners of grown boxes in clip space, for a rasterizer.

    Parameters
    ----------
    boxes : (6, k) float64
        World centers and half extents; extents count by magnitude.
    axes : (3, 3) float64
        Rows right, up, back.
    eye : (3,) float64
    projection : (4, 4) float64
        From eye space to clip space.
    pixels : width, height of one world unit at depth 1 (perspective) or anywhere (parallel)
    step : float
        Pixels by which the rasterizer may shift a corner.
    margin : float
        Pixels by which boxes are grown beyond what the rasterizer needs.
    reach : float
        World units: largest magnitude of the coordinates in which the contents are drawn, beyond the distance from the
        eye.
    near : float
        Distance of the near plane.
    parallel : bool

    Returns
    -------
    corners : (k, 8, 4) float32
        Of unknown boxes: zeros, which no rasterizer draws.
    unknown : (k,) bool
        The box reaches from behind the near plane to before it, or is not finite.
    """
    k = boxes.shape[1]
    corners, unknown = np.empty((k, 8, 4), np.float32), np.empty(k, bool)
    forward = -axes[2]
    # sideways, an error of w moves a point by the slope of its ray
    lean = 1.0 if parallel else 1.0 + float((1.0 / np.abs(np.diag(projection)[:2])).max())
    snapping = (2.0 * step + margin) / min(pixels)
    at_eye = 16 * _EPS64 * float(np.abs(eye).sum())
    turned = projection[:, :3] @ axes
    product = np.zeros((7, 8, 4))
    product[:3], product[6] = turned.T[:, None], projection[:, 3]
    product[3:6] = turned.T[:, None] * CORNER_SIGNS[:, :, None]
    largest = float(np.abs(product).max())
    with np.errstate(over="ignore", invalid="ignore"):
        for start in range(0, k, CHUNK):
            part = slice(start, start + CHUNK)
            relative = np.ones((7, min(CHUNK, k - start)))
            center, half = relative[:3], relative[3:6]
            np.subtract(boxes[:3, part], eye[:, None], out=center)
            np.abs(boxes[3:, part], out=half)
            size = np.abs(center).sum(axis=0) + half.sum(axis=0)
            middle = forward @ center
            half += ROUNDING * _EPS32 * lean * (reach + size) + 16 * _EPS64 * size + at_eye
            half += snapping if parallel else snapping * np.maximum(middle + np.abs(forward) @ half, 0.0)
            deep = np.abs(forward) @ half
            nearest, farthest = middle - deep, middle + deep
            known = ((nearest > near) | (farthest < near)) & (largest * 8 * size < _LARGEST)
            clip = (relative.T @ product.reshape(7, 32)).reshape(-1, 8, 4)
            depth_error = 2 * ROUNDING * _EPS32 * (reach + size)
            if parallel:
                bias = DEPTH_BIAS + depth_error * abs(projection[2, 2])
            else:
                # boxes behind the eye are clipped away whatever their depth
                bias = DEPTH_BIAS + depth_error / np.where(nearest > 0, nearest, np.inf)
            clip[:, :, 2] -= bias[:, None] * clip[:, :, 3]
            np.logical_not(known, out=unknown[part])
            corners[part] = clip
    if unknown.any():
        corners[unknown] = 0.0
    return corners, unknown
