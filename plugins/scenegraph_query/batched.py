"""Two-phase culling: draw what was visible in the last frame, ask about everything else at once, draw what is new."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import OUT, PARTIAL, Batch
from scenegraph.kernels.boxes import box_distance

from .asking import Asking
from .history import I64

#: With fewer drawables known from the last frame the nearest ones are drawn before the first question, too.
FEW_DRAWN = 16

#: Drawables drawn before the first question where nothing is known of the last frame; then twice as many each time.
FIRST = 256

#: With fewer nodes in a level a draw call of its own does not pay.
FEW_NODES = 16

#: Up to so many candidates are asked about without the hierarchy.
FLAT = 512


def batched(asking: Asking) -> None:
    """Find what is visible. Depth only comes nearer: what is rejected once stays so, what is seen is asked again."""
    frame, boxes = asking.frame, asking.snapshot.boxes
    eye = np.asarray(asking.view.eye)
    asking.draw(np.flatnonzero(asking.was | (asking.candidates & asking.snapshot.protected)))
    many = FIRST
    if np.count_nonzero(asking.taken) < FEW_DRAWN:
        asking.draw(nearest(boxes, frame.candidates(), eye, many))
    while True:
        reject(asking)
        new = np.flatnonzero(frame.visible & ~asking.taken)
        asking.asked[new] = True
        chosen = nearest(boxes, new, eye, many)
        asking.draw(chosen)
        if len(chosen) == len(new):
            return
        many *= 2


def reject(asking: Asking) -> None:
    """Ask about all that has not been drawn, and hide what is not seen."""
    tree, taken = asking.tree, asking.taken
    before = np.concatenate([[0], np.cumsum(taken, dtype=np.int32)])
    was_visible = asking.frame.visible.copy()

    def classify(batch: Batch) -> NDArray[np.int8]:
        index = batch.index
        # what is drawn would be seen, and so would a node around it
        ask = ~taken[index] if batch.is_rows else before[tree.end[index]] == before[tree.first[index]]
        which = np.flatnonzero(ask)
        verdict = np.full(len(index), PARTIAL, np.int8)
        if batch.is_rows or len(which) >= FEW_NODES:
            verdict[which[~asking.seen(batch.boxes_at(which))]] = OUT
        return verdict

    asking.frame.traverse(classify, flat=asking.frame.visible_count - int(before[-1]) <= FLAT)
    asking.hide_rows(np.flatnonzero(was_visible & ~asking.frame.visible))


def nearest(boxes: NDArray[np.float64], rows: I64, eye: NDArray[np.float64], count: int) -> I64:
    """At most `count` of some rows, those nearest to the eye; unknown boxes are nearest."""
    if len(rows) <= count:
        return rows
    return rows[np.argsort(box_distance(boxes[:, rows], eye), kind="stable")[:count]]
