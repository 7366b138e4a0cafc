"""Points against the planes of a view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Rounding of a plane's distance in units of float64 epsilon.
ROUNDING = 64.0


def point_outcodes(points: NDArray[np.float64], planes: NDArray[np.float64], /, *, size: float) -> NDArray[np.uint8]:
    """Of which planes each point is surely on the outer side, one bit per plane (Cohen & Sutherland).

    Two points with a bit in common lie outside the same plane, and so does all between them.

    Parameters
    ----------
    points : (3, ...) float64
    planes : (up to 8, 4) float64
        Inside is n·x + d ≥ 0.
    size : float
        No coordinate is larger.

    Returns
    -------
    (...) uint8
        Bit i, of value 2**i, for plane i. What is within rounding of a plane, or not a number, has no bit.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        level = planes[:, :3] @ points.reshape(3, -1)
        level += planes[:, 3:]
        limit = ROUNDING * float(np.finfo(np.float64).eps) * (size + np.abs(planes[:, 3:]))
        outside = level < -limit
    bits = np.array([1, 2, 4, 8, 16, 32, 64, 128], np.uint8)[: len(planes)]
    return np.asarray((bits @ outside.view(np.uint8)).reshape(points.shape[1:]))
