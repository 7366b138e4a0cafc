"""Boxes against shadow frusta: what lies surely and wholly behind a convex occluder.

Hudson et al., "Accelerated occlusion culling using shadow frusta", SCG 1997. A box is inside a frustum if the corner
that lies deepest on the outer side is inside each plane; for m frusta of p planes this is one (m·p × 8) @ (8 × k)
product and a minimum. Single precision first, float64 for what that cannot tell; every doubt goes against hiding.

Rows come from `scenegraph.kernels.silhouettes.cone_shadow_rows`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Rounding of an eight-term product and of its inputs, in units of the float format's epsilon.
ROUNDING = 8.0

#: Rows with such an offset, or its negative, are padding.
UNUSED = 1e30

#: Boxes in one product.
BLOCK = 4096

_EPS, _EPS32 = float(np.finfo(np.float64).eps), float(np.finfo(np.float32).eps)


def cone_rows_packed(
    rows: NDArray[np.float64],
    /,
    *,
    eye: NDArray[np.float64],
    origin: NDArray[np.float64],
    radius: float,
) -> tuple[NDArray[np.float32], float]:
    """Rows in single precision for boxes relative to an origin, moved inward by all that rounding can do.

    Parameters
    ----------
    rows : (..., 8) float64
        Relative to `eye`.
    eye, origin : (3,) float64
        World coordinates.
    radius : float
        Upper bound of |center - origin| + |half extent| over the boxes.

    Returns
    -------
    packed_rows : (..., 8) float32
    margin : float
        How far the planes were moved, at most.
    """
    away = eye - origin
    far = sum(map(abs, away.tolist())) + radius
    world = ROUNDING * _EPS * (sum(map(abs, origin.tolist())) + sum(map(abs, eye.tolist())) + radius)
    flat = rows.reshape(-1, 8)
    with np.errstate(over="ignore", invalid="ignore"):
        offset = flat[:, 6] - flat[:, :3] @ away
        margin = np.abs(offset)
        # rows that are not used hold for every box, or for none, and need no margin
        np.putmask(margin, margin > 0.5 * UNUSED, 0.0)
        margin += radius
        margin *= ROUNDING * _EPS32
        margin -= flat[:, 7] * far
        margin += world
        out = flat.astype(np.float32)
        offset -= margin
        out[:, 6] = offset
        out[:, 7] = 0.0
    largest = float(np.maximum.reduce(margin, initial=0.0))
    return out.reshape(rows.shape), largest if largest == largest else np.inf


def box_depth_in_frusta(
    packed: NDArray[np.float32], packed_rows: NDArray[np.float32], /, *, any_plane: bool = False
) -> NDArray[np.float32]:
    """How deep boxes lie inside frusta, in single precision and at least.

    Parameters
    ----------
    packed : (k, 8) float32
        From `scenegraph.kernels.boxes.box_packed`.
    packed_rows : (m, p, 8) float32
        From `cone_rows_packed`.
    any_plane : bool
        The greatest distance from one of the planes rather than the least: above 0 if the box is wholly inside one.

    Returns
    -------
    (m, k) float32
        Above 0: surely and wholly inside. Below minus twice the margin of `cone_rows_packed`: surely not. NaN for boxes
        with NaN.
    """
    m, p, _ = packed_rows.shape
    k = len(packed)
    rows = packed_rows.reshape(m * p, 8)
    out = np.empty((m, k), np.float32)
    extreme = np.maximum if any_plane else np.minimum
    with np.errstate(over="ignore", invalid="ignore"):
        # so many at a time that the products stay in the cache
        for start in range(0, k, BLOCK):
            part = packed[start : start + BLOCK].T
            distance = (rows @ part).reshape(m, p, part.shape[1])
            extreme.reduce(distance, axis=1, out=out[:, start : start + BLOCK])
    return out


def box_depth_in_frusta_exact(
    boxes: NDArray[np.float64], rows: NDArray[np.float64], /, *, eye: NDArray[np.float64], any_plane: bool = False
) -> NDArray[np.float64]:
    """How deep boxes lie inside frusta, at least, in float64 with a tolerance relative to the coordinates.

    Parameters
    ----------
    boxes : (6, k) float64
        World coordinates.
    rows : (m, p, 8) float64
        Relative to `eye`.
    eye : (3,) float64
    any_plane : bool
        The greatest distance from one of the planes rather than the least.

    Returns
    -------
    (m, k) float64
        Above 0: surely and wholly inside.
    """
    m, p, _ = rows.shape
    with np.errstate(over="ignore", invalid="ignore"):
        columns = np.ones((8, boxes.shape[1]))
        columns[:3] = boxes[:3] - eye[:, None]
        columns[3:6] = boxes[3:]
        columns[7] = np.abs(columns[:6]).sum(axis=0)
        # the world coordinates were rounded themselves: their magnitude counts, not that of the difference
        rounding = ROUNDING * _EPS * (np.abs(boxes).sum(axis=0) + np.abs(eye).sum())
        distance = (rows.reshape(m * p, 8) @ columns).reshape(m, p, boxes.shape[1])
        return np.asarray((distance.max(axis=1) if any_plane else distance.min(axis=1)) - rounding)


def box_touches_frusta(packed: NDArray[np.float32], packed_rows: NDArray[np.float32], /) -> NDArray[np.bool_]:
    """Which boxes may reach into which frusta: those of which no plane has the whole box outside.

    Parameters
    ----------
    packed : (k, 8) float32
    packed_rows : (m, p, 8) float32

    Returns
    -------
    (m, k) bool
        False only where nothing inside the box can be inside the frustum, as `box_depth_in_frusta` sees it.
    """
    m, p, _ = packed_rows.shape
    nearest = packed_rows.reshape(m * p, 8).copy()
    np.negative(nearest[:, 3:6], out=nearest[:, 3:6])
    with np.errstate(over="ignore", invalid="ignore"):
        depth = (nearest @ packed.T).reshape(m, p, len(packed)).min(axis=1)
        return np.asarray(~(depth < 0.0))


def box_hidden_from_region(
    boxes: NDArray[np.float64], rows: NDArray[np.float64], eyes: NDArray[np.float64], /
) -> NDArray[np.bool_]:
    """Which boxes one occluder hides from every point of a convex region.

    The viewpoints from which a point is hidden behind a convex occluder form a convex set: what the *same* occluder
    hides from all corners of a convex cell, it hides from all of the cell, except from inside the occluder itself.

    Parameters
    ----------
    boxes : (6, k) float64
        World coordinates.
    rows : (q, m, p, 8) float64
        Rows of m occluders for each of the q corners, each relative to its corner.
    eyes : (q, 3) float64
        The corners.

    Returns
    -------
    (m, k) bool
    """
    hidden = np.ones((rows.shape[1], boxes.shape[1]), bool)
    for corner, eye in zip(rows, eyes, strict=True):
        hidden &= box_depth_in_frusta_exact(boxes, corner, eye=eye) > 0.0
    return hidden
