"""How many pixels the image of a box covers.

Of the six faces of a box, at most three look at the eye, and their images do not overlap: the area of the box's image
is the sum of theirs. Schmalstieg & Tobler ("Fast projected area computation for three-dimensional bounding boxes",
1999) take the contour from a table of 27 cases instead; here all boxes take the same way through the arithmetic, and
the part of each face that lies on the screen is integrated edge by edge, so that nothing has to be clipped first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_SIGNS = np.array([[2 * (i >> axis & 1) - 1 for i in range(8)] for axis in range(3)], np.float64)
#: (3, 2, 4) corners of the faces of each axis, low and high, in a cycle; bit 0 of a corner's number is x, and so on.
_FACES = np.array([[[0, 2, 6, 4], [1, 3, 7, 5]], [[0, 1, 5, 4], [2, 3, 7, 6]], [[0, 1, 3, 2], [4, 5, 7, 6]]])


def box_pixel_area(
    boxes: F64,
    /,
    *,
    axes: F64,
    eye: F64,
    window: tuple[float, float, float, float],
    size: tuple[int, int],
    near: float,
    parallel: bool,
) -> F64:
    """Pixels that the images of boxes cover on the screen, as if nothing were in front of them.

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

    Returns
    -------
    (n,) float64
        Not rounded to whole pixels. NaN for boxes with a corner in front of the near plane, or that are not finite.
    """
    left, right, bottom, top = window
    width, height = size
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        relative = boxes[:3] - eye[:, None]
        corners = relative[:, None] + _SIGNS[:, :, None] * boxes[3:, None]
        x, y, back = np.einsum("ij,jkn->ikn", axes, corners)
        lost = ~(back.max(axis=0) <= -near)
        scale = 1.0 if parallel else -1.0 / back
        x = (x * scale - left) * (width / (right - left))
        y = (y * scale - bottom) * (height / (top - bottom))
        area = np.zeros(boxes.shape[1])
        for axis in range(3):
            # the eye lies this far beyond the low and beyond the high face
            toward = -np.sign(axes[2, axis]) if parallel else relative[axis]
            is_high = np.broadcast_to(toward < 0, area.shape)
            is_front = toward != 0 if parallel else np.abs(relative[axis]) > boxes[3 + axis]
            px, py = (np.where(is_high, c[_FACES[axis, 1]], c[_FACES[axis, 0]]) for c in (x, y))
            on_screen = np.abs(_under(px, py, np.roll(px, -1, axis=0), np.roll(py, -1, axis=0), width, height))
            area += np.where(is_front, on_screen, 0.0)
    return np.where(lost | ~np.isfinite(area), np.nan, area)


def _under(ax: F64, ay: F64, bx: F64, by: F64, width: float, height: float) -> F64:
    """(n,) signed area between the edges (4, n) and the lower border, within the screen."""
    x0, x1 = np.clip(ax, 0.0, width), np.clip(bx, 0.0, width)
    run = bx - ax
    upright = np.abs(run) <= 1e-12 * (np.abs(ax) + np.abs(bx))
    slope = (by - ay) / np.where(upright, 1.0, run)
    y0, y1 = ay + slope * (x0 - ax), ay + slope * (x1 - ax)
    rise = y1 - y0
    flat = np.abs(rise) <= 1e-9 * (np.abs(y0) + np.abs(y1) + height)
    mean = (_integral(y1, height) - _integral(y0, height)) / np.where(flat, 1.0, rise)
    mean = np.where(flat, np.clip(0.5 * (y0 + y1), 0.0, height), mean)
    return np.asarray(np.where(upright, 0.0, (x1 - x0) * mean).sum(axis=0))


def _integral(y: F64, height: float) -> F64:
    """Integral of the height clipped to the screen, from 0 to y."""
    inside = np.clip(y, 0.0, height)
    return np.asarray(0.5 * inside**2 + height * np.maximum(y - height, 0.0))


def box_cube_area(boxes: F64, /, *, eye: F64, pixels_at_one: float, parallel: bool) -> F64:
    """Pixels of one face of the cube that has a box's volume, seen from the front at the distance of its center.

    The estimate of Charalambos (section 4.3): f · (d' / d)², where f is the number of pixels of the face at a distance
    d'. 0 for a flat box; takes no notice of the screen's border.

    Parameters
    ----------
    boxes : (6, n) float64
    eye : (3,) float64
    pixels_at_one : float
        Pixels per world unit at distance 1; at any distance if `parallel`.

    Returns
    -------
    (n,) float64
        NaN for boxes around the eye or not finite.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        edge = np.cbrt(8.0 * boxes[3] * boxes[4] * boxes[5])
        away = np.ones(boxes.shape[1]) if parallel else np.linalg.norm(boxes[:3] - eye[:, None], axis=0)
        area = (edge * pixels_at_one / away) ** 2
    return np.where(np.isfinite(area), area, np.nan)
