"""Coherent hierarchical culling: what was visible is drawn without waiting, what was hidden is asked about meanwhile.

CHC: algorithms 1 to 4 of Charalambos, after Bittner et al. 2004. CHC++, Mattausch et al. 2008: previously hidden nodes
are gathered and asked about together (section 4), several that have been hidden for long by one query (section 5.1,
eqs. 1 to 3), visible ones not in every frame (section 5.2), and a node by the boxes of its children where these are
tighter (section 6). The probability that a node hidden for t frames stays so is theirs, 0.99 - 0.7 exp(-t). In the
second, nodes that were visible do not pass through the priority queue: they are opened as arrays, and what was visible
is drawn in step with the distance of the questions.

Which question is next depends on answers, so that there is a loop over queries in Python. What is known about several
at once is worked on as arrays.
"""

from __future__ import annotations

import heapq
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import Snapshot
from scenegraph.kernels.boxes import box_area

from .asking import F64, Asking
from .history import I64, Mask
from .opening import Entry, Opening

#: Children's boxes replace that of a node if their surfaces together are at most so many times its own.
TIGHT = 1.4

#: No query for more is worth most: the best number is 11 where each stays hidden with the highest probability, 0.99.
MOST = 16


@dataclass(frozen=True)
class Schedule:
    """How to ask. CHC: one at a time, neither `multi` nor `tight`.

    Attributes
    ----------
    batch : int
        Previously hidden nodes that are gathered before they are asked about.
    multi : bool
        Several of them by one query.
    ahead : bool
        Open all that was visible before the first question.
    tight : (m,) bool
        Nodes asked about by the boxes of their children.
    latency : int
        Nodes to go on with before an answer is fetched; 0 to fetch it as soon as it is there, which makes the order of
        asking depend on time.
    """

    batch: int
    multi: bool
    ahead: bool
    tight: Mask
    latency: int


@dataclass
class _Asked:
    """A ticket; group i of it is about numbers[first[i] : first[i + 1]]."""

    ticket: Any
    numbers: I64
    first: I64
    turn: int
    boxes: F64
    groups: I64


def coherent(asking: Asking, schedule: Schedule, *, retest: bool) -> None:
    """Find what is visible.

    Parameters
    ----------
    asking : Asking
    schedule : Schedule
    retest : bool
        Visible drawables are asked about at the end, all at once, and not one by one on the way.
    """
    traversal = (_Ahead if schedule.ahead else _InOrder)(asking, schedule, retest=retest)
    traversal.run()


class _InOrder:
    """Algorithms 1 to 4: nodes come from the priority queue one by one, those that were visible among them."""

    def __init__(self, asking: Asking, schedule: Schedule, *, retest: bool) -> None:
        self.asking, self.schedule = asking, schedule
        self.opening = Opening(asking)
        self.heap: list[Entry] = self.opening.start()
        self.turn = 0
        self.queue: deque[_Asked] = deque()
        self.hidden_before: list[int] = []
        tree = asking.tree
        # visibility pulled up: a node was visible if anything below it was
        visible = np.concatenate([[0], np.cumsum(asking.was, dtype=np.int32)])
        self.was: Mask = np.concatenate([visible[tree.end] > visible[tree.first], asking.was])
        #: Rows that were visible and are asked about again on the way.
        self.again: Mask = asking.was & ~asking.assumed & (not retest)
        self._frames = np.append(np.where(asking.candidates, asking.before.hidden_for, np.iinfo(np.int32).max), 0)

    def run(self) -> None:
        while self.heap or self.queue or self.hidden_before:
            while self.queue and (not self.heap or self._is_ready()):
                self._process(self.queue.popleft())
            if self.heap:
                self._advance()
            if self.hidden_before and (not self.heap or len(self.hidden_before) >= self.schedule.batch):
                self._ask_hidden()

    def _is_ready(self) -> bool:
        asked = self.queue[0]
        if self.schedule.latency:
            return self.turn - asked.turn >= self.schedule.latency
        return bool(self.asking.queries.ready(asked.ticket).all())

    def _advance(self) -> None:
        _, number = heapq.heappop(self.heap)
        self.turn += 1
        if not self.was[number]:
            self.hidden_before.append(number)
            return
        row = number - self.opening.nodes
        one = np.array([number])
        if row >= 0 and self.again[row]:
            self._issue(one, np.array([0, 1]))
        self._open(one)

    def _open(self, numbers: I64) -> None:
        for entry in self.opening.open(numbers):
            heapq.heappush(self.heap, entry)

    # -- asking -----------------------------------------------------------------------------------------------------

    def _ask_hidden(self) -> None:
        numbers = np.array(self.hidden_before)
        self.hidden_before.clear()
        if not self.schedule.multi:
            self._issue(numbers, np.arange(len(numbers) + 1))
            return
        frames = self._hidden_for(numbers)
        order = np.argsort(-frames, kind="stable")
        self._issue(numbers[order], multiqueries(0.99 - 0.7 * np.exp(-frames[order].astype(float))))

    def _issue(self, numbers: I64, first: I64) -> None:
        boxes, start = self._proxies(numbers)
        groups = start[first]
        self.queue.append(_Asked(self.asking.issue(boxes, groups), numbers, first, self.turn, boxes, groups))

    def _proxies(self, numbers: I64) -> tuple[F64, I64]:
        """Boxes that stand for nodes and rows: own ones, or those of the children; and where each one's start."""
        opening = self.opening
        rows = opening.is_row(numbers)
        tight = ~rows
        tight[tight] = self.schedule.tight[numbers[tight]]
        below, owner = opening.below_each(numbers[tight])
        plain = np.flatnonzero(~tight)
        owner = np.concatenate([np.flatnonzero(tight)[owner], plain])
        order = np.argsort(owner, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=len(numbers)))])
        return opening.boxes(np.concatenate([below, numbers[plain]])[order]), start

    def _hidden_for(self, numbers: I64) -> I64:
        """(k,) frames for which nodes and rows have been hidden, of a node all of it that is in the frustum."""
        tree, nodes, frames = self.asking.tree, self.opening.nodes, self._frames
        rows = self.opening.is_row(numbers)
        inner = np.where(rows, 0, numbers)
        first = np.where(rows, numbers - nodes, tree.first[inner])
        end = np.where(rows, numbers - nodes + 1, tree.end[inner])
        # of two neighbors, every second slice is one that was asked for
        found: I64 = np.minimum.reduceat(frames, np.stack([first, end], axis=1).ravel())[::2].astype(np.int64)
        return found

    # -- answers ----------------------------------------------------------------------------------------------------

    def _process(self, asked: _Asked) -> None:
        seen = self.asking.answered(asked.ticket, asked.boxes, asked.groups)
        size = np.diff(asked.first)
        each = np.repeat(seen, size)
        self.opening.hide(asked.numbers[~each])
        again = each & np.repeat(size > 1, size)
        if again.any():
            numbers = asked.numbers[again]
            self._issue(numbers, np.arange(len(numbers) + 1))
        found = asked.numbers[each & ~again]
        self.opening.mark_asked(found)
        # what was visible before is drawn, and opened, already
        self._open(found[~self.was[found]])


class _Ahead(_InOrder):
    """What was visible needs no answer: all of it is opened at once, and drawn as far as the next question reaches."""

    def __init__(self, asking: Asking, schedule: Schedule, *, retest: bool) -> None:
        super().__init__(asking, schedule, retest=retest)
        opening = self.opening
        if self.heap and self.was[0]:
            self.heap = opening.entries(opening.below(np.flatnonzero(self.was[: opening.nodes]), but=self.was))
            self.heap.sort()
        rows = np.flatnonzero(asking.was)
        away = opening.distance(opening.nodes + rows)
        order = np.argsort(away, kind="stable")
        self._rows, self._away, self._drawn = rows[order], away[order], 0

    def run(self) -> None:
        super().run()
        self._draw_up_to(np.inf)
        again = self.opening.nodes + np.flatnonzero(self.again)
        if len(again):
            # on the way they would be asked against less
            self._issue(again, np.arange(len(again) + 1))
            self._process(self.queue.popleft())

    def _advance(self) -> None:
        # as many as come before the next answer is fetched, or the batch is full
        count = min(self.schedule.batch - len(self.hidden_before), len(self.heap))
        if self.queue:
            count = min(count, max(self.queue[0].turn + self.schedule.latency - self.turn, 1))
        taken = self.heap[:count]
        del self.heap[:count]
        self.hidden_before.extend([number for _, number in taken])
        self.turn += count
        if len(self.hidden_before) >= self.schedule.batch or not self.heap:
            self._draw_up_to(taken[-1][0])

    def _open(self, numbers: I64) -> None:
        # many at a time are put in and taken out: a list that stays sorted is quicker than a heap
        self.heap.extend(self.opening.open(numbers))
        self.heap.sort()

    def _draw_up_to(self, distance: float) -> None:
        end = int(np.searchsorted(self._away, distance, side="right"))
        if end > self._drawn:
            self.asking.draw(self._rows[self._drawn : end])
            self._drawn = end


def tight_nodes(snapshot: Snapshot) -> Mask:
    """(m,) nodes whose children's boxes, or rows' boxes, have not much more surface together than their own."""
    tree = snapshot.tree
    leaf = tree.is_leaf
    below = np.where(
        leaf,
        _sums(box_area(snapshot.boxes), tree.first, tree.end),
        _sums(box_area(tree.boxes), tree.child_first, tree.child_end),
    )
    return np.asarray(below <= TIGHT * box_area(tree.boxes))


def _sums(values: F64, first: NDArray[np.int32], end: NDArray[np.int32]) -> F64:
    """(m,) sums of slices; not a number where a slice has a part that is none."""
    unknown = ~np.isfinite(values)
    total = np.concatenate([[0.0], np.cumsum(np.where(unknown, 0.0, values))])
    none = np.concatenate([[0], np.cumsum(unknown)])
    return np.where(none[end] > none[first], np.nan, total[end] - total[first])


def multiqueries(keep: F64) -> I64:
    """(g + 1,) where queries start that are worth most: number of nodes over the expected number of queries.

    Parameters
    ----------
    keep : (k,) float
        Probability that each node stays hidden, falling.
    """
    chances: list[float] = keep.tolist()
    first = [0]
    # in plain Python: a query is for a few nodes, and arrays of a few cost more
    while first[-1] < len(chances):
        start, best, most, all_stay = first[-1], 1, 1.0, 1.0
        for size, chance in enumerate(chances[start : start + MOST], 1):
            all_stay *= chance
            # a query for one node is never followed by others
            worth = size / (1 + (1 - all_stay) * size) if size > 1 else 1.0
            if worth > most:
                best, most = size, worth
        if best == 1:
            # those that follow are even less likely to stay hidden
            return np.concatenate([first, np.arange(start + 1, len(chances) + 1)])
        first.append(start + best)
    return np.array(first)
