"""From a pool of good occluders to the few that are used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import View

from .frusta import Bools, Floats, Ints, Shapes

#: Columns and rows of samples on the far plane, for the marginal ranking.
SAMPLES = (24, 14)

#: What a sample is still worth under one more shadow. Not 0: what lies across the border of two shadows is in neither.
WORTH = 0.25

#: A share of the distance by which an occluder may stick out of another's shadow and still be dropped: dropping is
#: safe.
LENIENT = 1e-9


def covered(shapes: Shapes, rows: Floats, good: Bools, most: int) -> Bools:
    """(m,) which occluders add nothing, because the shadow of another one holds theirs.

    Only the first `most` good ones are asked. Of two that hide each other, the one of lower rank goes.
    """
    m, p, _ = rows.shape
    asked = good.nonzero()[0][:most]
    k = len(asked)
    boxes = np.ones((7, m))
    low, high = np.minimum.reduce(shapes.points, axis=1), np.maximum.reduce(shapes.points, axis=1)
    np.multiply(high + low, 0.5, out=boxes[:3])
    np.multiply(high - low, 0.5, out=boxes[3:6])
    # planes first: the minimum then runs along whole rows
    planes = rows.transpose(1, 0, 2).take(asked, axis=1).reshape(-1, 8)[:, :7]
    depth = np.minimum.reduce((planes @ boxes).reshape(p, k * m), axis=0).reshape(k, m)
    holds = depth >= -LENIENT * np.add.reduce(np.abs(boxes[:6]), axis=0)
    among = holds.take(asked, axis=1)
    among.reshape(-1)[:: k + 1] = False
    out: Bools = np.logical_or.reduce(holds, axis=0)
    rank = np.arange(k)
    out[asked] = np.logical_or.reduce(among & ((rank[:, None] < rank) | ~among.T), axis=0)
    return out


def by_solid_angle(shapes: Shapes, good: Bools) -> Ints:
    """Positions of good occluders by falling solid angle; equal ones by number."""
    which = good.nonzero()[0]
    # what rounding alone tells apart counts as equal
    angle = shapes.solid_angles()[which].astype(np.float32)
    return which[np.lexsort((shapes.ids[which], -angle))]


def by_margin(rows: Floats, good: Bools, view: View, count: int) -> Ints:
    """Positions of good occluders, each the one that adds most to those before it.

    The measure is a grid of samples on the far plane. One that is in a shadow already counts less. Occluders that
    reach no sample follow in the order of the pool.

    Parameters
    ----------
    rows : (m, p, 8) float64
    good : (m,) bool
    view : View
    count : int
        As many as are wanted.
    """
    which = good.nonzero()[0]
    samples, planes = _samples(view), rows[which].reshape(-1, 8)
    beyond = planes[:, :3] @ samples + planes[:, 6:7] > 0.0
    whole = np.logical_and.reduce(beyond.reshape(len(which), rows.shape[1], samples.shape[1]), axis=1)
    covers: NDArray[np.float32] = whole.astype(np.float32)
    left: NDArray[np.float32] = np.ones(covers.shape[1], np.float32)
    order: list[int] = []
    free = np.ones(len(which), np.float32)
    for _ in range(min(count, len(which))):
        gain = (covers @ left) * free
        best = int(np.argmax(gain))
        if not np.max(gain) > 0.0:
            break
        order.append(best)
        free[best] = 0.0
        np.multiply(left, WORTH, out=left, where=covers[best] > 0.0)
    order.extend(free.nonzero()[0].tolist())
    return which[np.array(order, np.int64)]


def _samples(view: View) -> Floats:
    """(3, s) points on the far plane, evenly over the window, relative to the eye."""
    left, right, bottom, top = view.window
    columns, rows = SAMPLES
    x = left + (np.arange(columns) + 0.5) * ((right - left) / columns)
    y = bottom + (np.arange(rows) + 0.5) * ((top - bottom) / rows)
    points = np.stack([np.tile(x, rows), np.repeat(y, columns), np.full(columns * rows, -1.0)])
    if view.is_parallel:
        points[2] = -view.far
    else:
        points *= view.far
    return np.asarray(view.axes.T @ points)
