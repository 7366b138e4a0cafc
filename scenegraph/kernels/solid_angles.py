"""Solid angles of triangles seen from the eye.

Van Oosterom & Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30(2), 1983: exact for any
triangle, and stable for thin ones, because no angle is computed from a cosine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def angle_solid_triangles(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], /
) -> NDArray[np.float64]:
    """Signed solid angles of triangles.

    Parameters
    ----------
    a, b, c : (3, ...) float64
        Corners relative to the eye, or directions to them: only the directions count.

    Returns
    -------
    (...) float64
        Steradians in (-2π, 2π), positive where a, b, c run counterclockwise seen from the eye; NaN where a corner
        coincides with the eye.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c = (v / np.sqrt((v * v).sum(axis=0)) for v in (a, b, c))
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    side = 1.0 + (a * b).sum(axis=0) + (b * c).sum(axis=0) + (c * a).sum(axis=0)
    # from behind the corners run clockwise: the triple product is negative where they look counterclockwise
    return np.asarray(-2.0 * np.arctan2(volume, side))
