"""Axis-aligned boxes, components first: (6, n) rows are center x, y, z and half extent x, y, z."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Rounding of a seven-term product and of its inputs, in units of the float format's epsilon.
ROUNDING = 8.0

_EPS32, _MAX32 = float(np.finfo(np.float32).eps), float(np.finfo(np.float32).max)

#: Inward normals of an axis-aligned box.
_AXES = np.concatenate([np.eye(3), -np.eye(3)])


def box_from_bounds(low: NDArray[np.float64], high: NDArray[np.float64], /) -> NDArray[np.float64]:
    """Boxes from lowest and highest corners.

    Parameters
    ----------
    low, high : (3, n) float64

    Returns
    -------
    (6, n) float64
        Half extents are rounded up, so that the box never loses its corners.
    """
    center = low + 0.5 * (high - low)
    with np.errstate(invalid="ignore"):
        half = np.maximum(high - center, center - low)
    return np.concatenate([center, np.nextafter(half, np.inf)])


def box_to_bounds(boxes: NDArray[np.float64], /) -> NDArray[np.float64]:
    """(6, n) low corners, then high corners, of (6, n) boxes."""
    return np.concatenate([boxes[:3] - boxes[3:], boxes[:3] + boxes[3:]])


def box_transformed(boxes: NDArray[np.float64], matrices: NDArray[np.float64], /) -> NDArray[np.float64]:
    """World boxes of local boxes, one affine matrix each.

    Parameters
    ----------
    boxes : (6, n) float64
    matrices : (n, 4, 4) float64

    Returns
    -------
    (6, n) float64
        Tightest boxes of the transformed boxes (not of what is in them).
    """
    linear = matrices[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        center = np.einsum("nij,jn->in", linear, boxes[:3]) + matrices[:, :3, 3].T
        half = np.einsum("nij,jn->in", np.abs(linear), boxes[3:])
    return np.concatenate([center, half])


def box_packed(boxes: NDArray[np.float64], origin: NDArray[np.float64], /) -> NDArray[np.float32]:
    """Single-precision boxes relative to an origin, grown so that each encloses its double.

    Parameters
    ----------
    boxes : (6, n) float64
    origin : (3,) float64
        Subtracted in float64.

    Returns
    -------
    (n, 8) float32
        Center, half extent, 1, 0: the transpose multiplies (p, 8) plane rows from the right.
    """
    packed = np.zeros((boxes.shape[1], 8), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        center = (boxes[:3] - np.asarray(origin)[:, None]).T
        packed[:, :3] = center
        packed[:, 3:6] = np.nextafter(
            (boxes[3:].T + np.abs(center - packed[:, :3])).astype(np.float32), np.float32(np.inf)
        )
    packed[:, 6] = 1.0
    return packed


def box_distance(boxes: NDArray[np.float64], point: NDArray[np.float64], /) -> NDArray[np.float64]:
    """(k,) distance of a point (3,) from boxes (6, k), 0 inside and for boxes with NaN."""
    with np.errstate(invalid="ignore", over="ignore"):
        away = np.fmax(np.abs(boxes[:3] - point[:, None]) - np.abs(boxes[3:]), 0.0)
        return np.asarray(np.sqrt((away * away).sum(axis=0)))


def box_area(boxes: NDArray[np.float64], /) -> NDArray[np.float64]:
    """(k,) surface of boxes (6, k)."""
    x, y, z = np.abs(boxes[3:])
    return np.asarray(8.0 * (x * y + y * z + z * x))


def box_plane_rows(planes: NDArray[np.float64], /, *, nearest: bool = False) -> NDArray[np.float64]:
    """(p, 8) rows whose product with packed boxes is the signed distance of a box's farthest (or nearest) corner.

    Parameters
    ----------
    planes : (p, 4) float64
        Unit normal and offset; inside is n·x + d ≥ 0.
    nearest : bool
        The corner deepest on the outside instead: ≥ 0 means that the whole box is inside.
    """
    rows = np.zeros((len(planes), 8))
    rows[:, :3] = planes[:, :3]
    np.abs(rows[:, :3], out=rows[:, 3:6])
    if nearest:
        np.negative(rows[:, 3:6], out=rows[:, 3:6])
    rows[:, 6] = planes[:, 3]
    return rows


def box_outside(
    packed: NDArray[np.float32], planes: NDArray[np.float64], /, *, radius: float
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which boxes lie wholly outside one of the planes, in single precision; and which need another look.

    One (p × 8) @ (8 × n) product replaces any per-box work. Its rounding error is bounded by `radius`; boxes within
    that bound of a plane are returned as unsure, for `box_outside_exact`.

    Parameters
    ----------
    packed : (n, 8) float32
        From `box_packed`.
    planes : (p, 4) float64
        Relative to the same origin, unit normals.
    radius : float
        Upper bound of |center - origin| + |half extent| over the boxes.

    Returns
    -------
    outside : (n,) bool
        Surely outside. NaN is not.
    unsure : (k,) int64
        Indices of boxes that may be outside as well.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.minimum.reduce(box_plane_rows(planes).astype(np.float32) @ packed.T, axis=0)
        bound = _rounding_bound(planes, radius)
        outside = distance < -bound
        # what is neither surely outside nor surely not, NaN included
        decided = np.abs(distance, out=distance) > bound
    if np.count_nonzero(decided) == len(decided):
        return outside, np.zeros(0, np.int64)
    return outside, (~decided).nonzero()[0]


def _rounding_bound(planes: NDArray[np.float64], radius: float) -> float:
    bound = ROUNDING * _EPS32 * (radius + max(map(abs, planes[:, 3].tolist())))
    return bound if bound < _MAX32 else np.inf


def box_outside_exact(
    boxes: NDArray[np.float64], planes: NDArray[np.float64], /, *, origin: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which boxes lie wholly outside one of the planes, in float64 with a tolerance relative to the coordinates.

    Parameters
    ----------
    boxes : (6, n) float64
        World coordinates.
    planes : (p, 4) float64
        Relative to `origin`, unit normals.
    origin : (3,) float64

    Returns
    -------
    (n,) bool
    """
    with np.errstate(over="ignore", invalid="ignore"):
        relative = boxes.copy()
        relative[:3] -= np.asarray(origin)[:, None]
        normal = np.abs(planes[:, :3])
        # the world coordinates were rounded themselves: their magnitude counts, not that of the difference
        size = np.abs(boxes[:3]) + np.abs(np.asarray(origin))[:, None] + boxes[3:]
        tolerance = ROUNDING * np.finfo(np.float64).eps * (normal @ size + np.abs(planes[:, 3:]))
        distance = planes[:, :3] @ relative[:3] + normal @ relative[3:] + planes[:, 3:]
        return np.asarray((distance < -tolerance).any(axis=0))


def box_inside(packed: NDArray[np.float32], planes: NDArray[np.float64], /, *, radius: float) -> NDArray[np.bool_]:
    """Which boxes lie wholly inside all planes, surely so in spite of rounding; see `box_outside`."""
    with np.errstate(over="ignore", invalid="ignore"):
        rows = box_plane_rows(planes, nearest=True).astype(np.float32)
        return np.asarray(np.minimum.reduce(rows @ packed.T, axis=0) > _rounding_bound(planes, radius))


def box_planes(low: NDArray[np.float64], high: NDArray[np.float64], /) -> NDArray[np.float64]:
    """(6, 4) inward planes of the box [low, high]."""
    planes = np.empty((6, 4))
    planes[:, :3] = _AXES
    np.negative(low, out=planes[:3, 3])
    planes[3:, 3] = high
    return planes
