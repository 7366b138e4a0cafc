"""Relief on upright walls: boxes, panels and bands placed in a wall's own coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .shapes import Floats, Shape

#: For each side of a box: the direction to the right for someone who looks at it, and outward, as (axis, sign).
RIGHT = {"-y": (0, 1), "+y": (0, -1), "-x": (1, -1), "+x": (1, 1)}
OUT = {"-y": (1, -1), "+y": (1, 1), "-x": (0, -1), "+x": (0, 1)}

Half = tuple[float, float]
Span = tuple[ArrayLike, ArrayLike]


class Wall:
    """One upright side of a box centered on the z axis; u runs to the right from its middle, v outward, z up.

    Parameters
    ----------
    side : "-x", "+x", "-y" or "+y"
    half : 2 floats
        Half width (x) and half depth (y) of the box.
    """

    def __init__(self, side: str, half: Half) -> None:
        self.side = side
        self.u_axis, self.u_sign = RIGHT[side]
        self.v_axis, self.v_sign = OUT[side]
        self.half_width = half[self.u_axis]
        self.face = half[self.v_axis]

    def bays(self, count: int) -> Floats:
        """(count,) middles of equal bays."""
        return np.asarray(((np.arange(count) + 0.5) / count * 2 - 1) * self.half_width)

    def points(self, u: ArrayLike, v: ArrayLike, z: ArrayLike) -> Floats:
        """(..., 3) points of the broadcast coordinates."""
        u, v, z = np.broadcast_arrays(*(np.asarray(a, np.float64) for a in (u, v, z)))
        p = np.empty((*u.shape, 3))
        p[..., self.u_axis] = self.u_sign * u
        p[..., self.v_axis] = self.v_sign * (self.face + v)
        p[..., 2] = z
        return p

    def boxes(self, shape: Shape, u: Span, v: Span, z: Span, faces: str = "olrtb") -> None:
        """Add boxes of the broadcast extents; `faces` is any of o(ut), l(eft), r(ight), t(op), b(ottom)."""
        a, b = (self.points(u[i], v[i], z[i]) for i in (0, 1))
        a, b = (p.reshape(-1, 3) for p in np.broadcast_arrays(a, b))
        axis = "xy"[self.u_axis]
        left, right = ("-" + axis, "+" + axis)[:: self.u_sign]
        names = {"o": self.side, "l": left, "r": right, "t": "+z", "b": "-z"}
        shape.boxes(np.minimum(a, b), np.maximum(a, b), [names[f] for f in faces])

    def panels(self, shape: Shape, u: Span, v: ArrayLike, z: Span, color: tuple[float, ...] | None = None) -> None:
        """Add upright rectangles at the distance v from the wall."""
        corners = [self.points(u[i], v, z[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        shape.polygons(np.stack(np.broadcast_arrays(*corners), axis=-2).reshape(-1, 4, 3), color)


def ring(shape: Shape, half: Half, z: Span, out: float, faces: str = "otb", inner: float = 0.0) -> None:
    """Add bands around a rectangle, mitered at its corners.

    Parameters
    ----------
    half : 2 floats
        Half sizes of the rectangle.
    z : 2 floats or 2 arrays (k,)
        Lower and upper edges of k bands.
    out, inner : float
        How far the outer and the inner face lie outside the rectangle.
    faces : str
        Any of o(ut), t(op), b(ottom), i(nner).
    """
    low, high = (np.atleast_1d(np.asarray(a, np.float64)) for a in z)
    turn = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    rim, core = turn * (np.asarray(half) + out), turn * (np.asarray(half) + inner)
    after = np.roll(np.arange(4), -1)
    edges = {
        "o": ((rim, low), (rim[after], low), (rim[after], high), (rim, high)),
        "t": ((rim, high), (rim[after], high), (core[after], high), (core, high)),
        "b": ((core, low), (core[after], low), (rim[after], low), (rim, low)),
        "i": ((core, high), (core[after], high), (core[after], low), (core, low)),
    }
    for face in faces:
        corners = [
            np.concatenate([np.broadcast_to(xy, (len(h), 4, 2)), np.broadcast_to(h[:, None, None], (len(h), 4, 1))], 2)
            for xy, h in edges[face]
        ]
        shape.polygons(np.stack(corners, axis=2).reshape(-1, 4, 3))
