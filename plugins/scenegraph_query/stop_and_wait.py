"""Hierarchical stop and wait (Bittner et al. 2004, section 4.1): front to back, one question at a time."""

from __future__ import annotations

import heapq

import numpy as np

from .asking import Asking
from .opening import Opening


def stop_and_wait(asking: Asking) -> None:
    """Find what is visible, with the time of a whole round trip to the GPU for each question.

    The order of questions follows from the answers, so that there is one turn of the loop for each.
    """
    opening = Opening(asking)
    heap = opening.start()
    while heap:
        number = np.array([heapq.heappop(heap)[1]])
        boxes = opening.boxes(number)
        if asking.answered(asking.issue(boxes), boxes)[0]:
            opening.mark_asked(number)
            for entry in opening.open(number):
                heapq.heappush(heap, entry)
        else:
            opening.hide(number)
