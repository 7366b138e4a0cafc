"""Which level of detail: within an error, and within a budget of triangles.

Levels count from 0, the finest. Errors do not fall from level to level. Arrays over levels are (L, k), one column per
drawable; a level that a drawable does not have has an error of +inf.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Drawables given back together when a budget is filled up.
_GIVEN_BACK = 4096


def box_distance(boxes: NDArray[np.float64], point: NDArray[np.float64], /) -> NDArray[np.float64]:
    """Distance of a point from boxes: 0 inside.

    Parameters
    ----------
    boxes : (6, k) float64
        Centers and half extents, components first.
    point : (3,) float64

    Returns
    -------
    (k,) float64
        NaN for boxes with NaN.
    """
    out = np.zeros(boxes.shape[1])
    for axis in range(3):
        away = np.abs(boxes[axis] - point[axis]) - boxes[3 + axis]
        np.maximum(away, 0.0, out=away)
        out += away * away
    return np.asarray(np.sqrt(out, out=out))


def mesh_level_within(errors: NDArray[np.floating], limit: NDArray[np.floating], /) -> NDArray[np.int64]:
    """Find the coarsest level whose error, and that of all finer ones, is within a limit.

    Parameters
    ----------
    errors : (L, k) float
        Of level 0 and on; what is unknown (NaN) is not within.
    limit : (k,) float
        NaN keeps the finest level.

    Returns
    -------
    (k,) int64
    """
    out = np.zeros(errors.shape[1], np.int64)
    within = np.ones(errors.shape[1], bool)
    for error in errors[1:]:
        within &= error <= limit
        out += within
    return out


def mesh_level_budget(
    errors: NDArray[np.float32],
    triangles: NDArray[np.integer],
    base: NDArray[np.integer],
    /,
    *,
    budget: int,
    enough: float = 0.995,
) -> NDArray[np.int64]:
    """Levels of the least largest error whose triangles are within a budget.

    Each step of a drawable to its next coarser level has a threshold, that level's error, and saves some triangles. The
    steps are taken in the order of their thresholds, then of drawables, until what is left fits: no other choice has a
    smaller largest error. What the last step saved too much is then given back: steps are undone, the largest error
    first, as far as each fits, until `enough` of the budget is used. More budget never gives fewer triangles.

    Parameters
    ----------
    errors : (L, k) float32
        Of each level as seen, in pixels say; not negative, +inf for levels that do not exist.
    triangles : (L, k) int
        Anything where a level does not exist.
    base : (k,) int
        The level that each drawable has already: it can only get coarser.
    budget : int
    enough : float
        Share of the budget that is enough.

    Returns
    -------
    (k,) int64
        Levels; the coarsest ones where even those do not fit.
    """
    levels, k = errors.shape
    start: NDArray[np.int64] = base.astype(np.int64)
    number = np.arange(levels)[:, None]
    exists = np.isfinite(errors) | (number == 0)
    # a coarser level may have more triangles than a finer one: each counts with the most of what follows it
    count = np.where(exists, triangles, 0).astype(np.int64)
    count = np.maximum.accumulate(count[::-1], axis=0)[::-1]
    rows = np.arange(k)
    total = int(count[start, rows].sum())
    if levels < 2 or total <= budget:
        return start
    usable = exists[1:] & (number[1:] > start)
    saves = np.where(usable, count[:-1] - count[1:], 0)
    # bits of a float that is not negative rise with it
    bits = np.where(usable, errors[1:], np.float32(np.inf)).astype(np.float32).view(np.uint32)
    bits, saves = bits.reshape(-1), saves.reshape(-1)
    bins = (bits >> 16).astype(np.int64)
    # sums of whole numbers below 2^53 are exact in doubles
    saved = np.cumsum(np.bincount(bins, saves, minlength=1 << 16))
    if total - saved[-1] > budget:
        return np.asarray(start + usable.sum(axis=0))
    cut = int(np.searchsorted(saved, total - budget))
    taken = bins < cut
    left = total - int(saved[cut - 1] if cut else 0) - budget
    border = np.flatnonzero(bins == cut)
    # by threshold, then by drawable, then by level: a drawable's steps come in order
    border = border[np.lexsort((border // k, border % k, bits[border]))]
    needed = int(np.searchsorted(np.cumsum(saves[border]), left)) + 1
    taken[border[:needed]] = True
    slack = int(saves[border[:needed]].sum()) - left
    _give_back(taken, saves, bits, k, slack=slack, spare=int((1 - enough) * budget), last=int(border[needed - 1]))
    return np.asarray(start + (taken.reshape(levels - 1, k) & usable).sum(axis=0))


def _give_back(
    taken: NDArray[np.bool_],
    saves: NDArray[np.int64],
    bits: NDArray[np.uint32],
    k: int,
    *,
    slack: int,
    spare: int,
    last: int,
) -> None:
    """Undo steps, the largest threshold first, as long as they fit; a step that does not keeps those below it, too."""
    blocked = np.zeros(k, bool)
    blocked[last % k] = True
    todo = np.flatnonzero(taken)
    size = _GIVEN_BACK
    while slack > spare and len(todo):
        todo = todo[~blocked[todo % k]]
        if not len(todo):
            return
        some = todo
        if len(todo) > size:
            # all of an equal threshold together, so that the order does not depend on the size of the portion
            least = np.partition(bits[todo], len(todo) - size)[len(todo) - size]
            some = todo[bits[todo] >= least]
            todo = todo[bits[todo] < least]
        else:
            todo = todo[:0]
        some = some[np.lexsort((-(some // k), -(some % k), -bits[some].astype(np.int64)))]
        size *= 4
        while slack > spare and len(some):
            large = saves[some] > slack
            if large.any():
                # slack only shrinks: what does not fit now never will, nor can what its drawable has below it
                blocked_now = np.full(k, len(some))
                np.minimum.at(blocked_now, some[large] % k, np.flatnonzero(large))
                keep = np.arange(len(some)) < blocked_now[some % k]
                blocked[some[large] % k] = True
                some = some[keep]
                if not len(some):
                    break
            running = np.cumsum(saves[some])
            fits = int(np.searchsorted(running, slack, side="right"))
            taken[some[:fits]] = False
            slack -= int(running[fits - 1]) if fits else 0
            some = some[fits:]
