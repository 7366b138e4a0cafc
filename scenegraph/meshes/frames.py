"""In which directions a shape is square: the axes in which boxes fit it best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

#: How much more of the surface has to face along an axis for turned axes to be worth it.
_GAIN = 0.02


def main_axes(triangles: F64) -> F64:
    """Rows of a rotation such that much of the surface faces along one of them.

    Parameters
    ----------
    triangles : (m, 3, 3) float64

    Returns
    -------
    (3, 3) float64
        The identity if no other axes are clearly better.
    """
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.sqrt(np.einsum("ij,ij->i", cross, cross))
    proper = area > 1e-14
    normal, area = cross[proper] / area[proper, None], area[proper]
    first = _most_common(normal, area)
    if first is None:
        return np.eye(3)
    across = np.abs(normal @ first) < 0.05
    second = _most_common(normal[across], area[across])
    if second is None:
        return np.eye(3)
    second = second - first * (first @ second)
    second /= np.linalg.norm(second)
    axes = np.stack([first, second, np.cross(first, second)])
    # in the order and direction nearest to the usual axes, so that nearly equal shapes get nearly equal boxes
    axes = axes[np.argsort(np.abs(axes).argmax(axis=1), kind="stable")]
    axes *= np.where(axes[np.arange(3), np.abs(axes).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]

    def facing(rows: F64) -> float:
        return float(np.abs(normal @ rows.T).max(axis=1) @ area / area.sum())

    return axes if facing(axes) > facing(np.eye(3)) + _GAIN else np.eye(3)


def _most_common(normal: F64, area: F64) -> F64 | None:
    """The direction, either way, that most of the area faces."""
    if not len(area):
        return None
    largest = np.take_along_axis(normal, np.abs(normal).argmax(axis=1)[:, None], axis=1)
    folded = np.where(largest < 0, -normal, normal)
    bins = np.unique(np.round(folded * 64).astype(np.int64), axis=0, return_inverse=True)[1].reshape(-1)
    best = bins == np.bincount(bins, area).argmax()
    mean = (folded[best] * area[best, None]).sum(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))
