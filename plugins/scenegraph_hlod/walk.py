"""The traversals: coherent HLOD culling (Algorithms 1 to 4 of the paper) and hierarchical stop-and-wait.

The paper's loop takes one node at a time from a queue ordered by distance. Here it takes `chunk` nodes at a time, so
that a frame is some dozens of array operations and draw calls instead of hundreds of Python steps; with ``chunk=1`` it
is the paper's loop, node by node. What is drawn of a chunk is drawn before its queries are issued, so that they see it;
a node's own mesh lies inside its box and cannot hide it.

Sections 5.1 and 5.2 in these terms. A node that was visible in the previous frame is handled without waiting, by a
predicted μ̂: 1 − s / S from its place s in the queue, or what was measured last (`predictor="temporal"`). "The scheduled
position of the node in the priority queue" can be read in two ways: how many were scheduled before it in this frame
(`"queue"`), or its rank among those that wait when it is scheduled (`"rank"`), which is never far from 0. All others
are handled when their answer is there, by the measured μ. A drawn node whose answer says that it needs refinement (RARN
in Table 1) is taken out of the picture again and its children take its place, drawn without waiting: the paper draws
both.

The paper takes an answer as soon as it is there. When that is depends on the clock, and so would what is drawn. Here
it is taken `lag` chunks later, waiting if need be, so that a run can be repeated bit for bit.

What trimming adds: the picture is drawn after the walk, not during it, so that a node which was drawn by prediction and
whose query then finds nothing visible need not be in it. Whatever hides it is nearer, and stays or is itself hidden by
something nearer.

What the temporal predictor adds: nodes that are refined are asked, too. The paper asks only nodes at which refinement
stops, so that a node that was refined once would be refined as long as anything of it is visible.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from .cut import HlodCut
from .measures import Bools, Floats, Ints, Measures

Predictor = Literal["temporal", "queue", "rank"]

_NONE = np.zeros(0, np.int64)


class Questions(Protocol):
    """Who draws and answers."""

    def draw(self, nodes: Ints) -> None:
        """Draw nodes into what is asked about, in this order."""

    def issue(self, nodes: Ints) -> Any:
        """Ask how many samples of the boxes of nodes are visible."""

    def result(self, ticket: Any) -> Ints:
        """Visible samples of each node of a ticket; waits for them."""


@dataclass(frozen=True)
class Rules:
    """How a walk decides.

    Attributes
    ----------
    threshold : float
        τ in pixels.
    by_visibility : bool
        The metric is ε^q; ε without.
    predictor : "temporal", "queue" or "rank"
        μ̂ is what was measured last, or falls with the place in the queue, read in one of two ways.
    waits : bool
        Stop and wait: nothing is known of the previous frame.
    chunk : int
        Nodes taken from the queue at a time.
    lag : int
        Chunks after which an answer is taken.
    trims : bool
        What was drawn by prediction and is found hidden is taken out of the picture again.
    """

    threshold: float
    by_visibility: bool
    predictor: Predictor
    waits: bool
    chunk: int
    lag: int
    trims: bool


class Walk:
    """One frame's walk through a tree.

    Parameters
    ----------
    measures : Measures
    questions : Questions
    rules : Rules
    before : HlodCut, optional
        Of the previous frame of the same view.
    """

    def __init__(self, measures: Measures, questions: Questions, rules: Rules, before: HlodCut | None) -> None:
        tree = measures.tree
        m = len(tree)
        self.measures, self.questions, self.rules = measures, questions, rules
        self.tree = tree
        known = before is not None and not rules.waits
        self.was_visible: Bools = before.visible & before.visited if known and before is not None else np.zeros(m, bool)
        self.share: Floats = before.share.copy() if before is not None else np.full(m, np.nan)
        self.last_scheduled = before.scheduled if before is not None else 0
        self.visible = np.zeros(m, bool)
        self.visited = np.zeros(m, bool)
        self.drawn = np.zeros(m, bool)
        self.refined = np.zeros(m, bool)
        self.samples = np.full(m, -1, np.int64)
        #: s of each scheduled node.
        self.place = np.zeros(m, np.int64)
        self.scheduled = 0
        self.rarn = self.trimmed = 0
        self._queue: Ints = _NONE
        self._asked: deque[tuple[Ints, Any]] = deque()

    def run(self, index: int) -> HlodCut:
        """Walk, and return what was found."""
        self._schedule(np.zeros(min(len(self.tree), 1), np.int64))
        while len(self._queue) or self._asked:
            self._answers()
            if len(self._queue):
                self._traverse(self._front())
        return HlodCut(
            self.tree,
            np.flatnonzero(self.drawn),
            self.measures.errors,
            self.share,
            self.samples,
            self.visible,
            self.visited,
            self.scheduled,
            index,
        )

    # -- the queue ----------------------------------------------------------------------------------------------------

    def _schedule(self, nodes: Ints) -> None:
        """Put nodes into the queue, the nearest first."""
        if not len(nodes):
            return
        nodes = nodes[np.lexsort((nodes, self.measures.distance[nodes]))]
        before: int | Ints = self.scheduled
        if self.rules.predictor == "rank":
            distance = self.measures.distance
            before = np.searchsorted(np.sort(distance[self._queue]), distance[nodes], side="right")
        self.place[nodes] = before + np.arange(len(nodes))
        self.scheduled += len(nodes)
        self._queue = np.concatenate([self._queue, nodes])

    def _front(self) -> Ints:
        """Take the nearest nodes out of the queue."""
        queue = self._queue
        order = np.lexsort((queue, self.measures.distance[queue]))
        self._queue = queue[order[self.rules.chunk :]]
        return queue[order[: self.rules.chunk]]

    # -- Algorithm 3 --------------------------------------------------------------------------------------------------

    def _traverse(self, nodes: Ints) -> None:
        nodes = nodes[~self.measures.outside[nodes]]
        if not len(nodes):
            return
        self.visited[nodes] = True
        was = self.was_visible[nodes]
        old = nodes[was]
        stops = self._stops(old, self._predicted(old))
        self._draw(old[stops])
        refined = old[~stops]
        self._refine(refined)
        ask = np.ones(len(nodes), bool)
        if self.rules.predictor != "temporal":
            ask[was] = stops
        asked = nodes[ask]
        if len(asked):
            self._asked.append((asked, self.questions.issue(asked)))

    def _predicted(self, nodes: Ints) -> Floats:
        """(k,) μ̂ (section 5.2); 1 for boxes that will not be asked, whose μ is 1 whatever stands before them."""
        if not self.rules.by_visibility:
            return np.ones(len(nodes))
        if self.rules.predictor == "temporal":
            share = self.share[nodes]
        elif self.last_scheduled:
            share = np.clip(1.0 - self.place[nodes] / self.last_scheduled, 0.0, 1.0)
        else:
            share = np.ones(len(nodes))
        return np.where(np.isnan(share) | ~self.measures.counts[nodes], 1.0, share)

    def _stops(self, nodes: Ints, share: Floats) -> Bools:
        """(k,) where refinement stops: ε · μ ≤ τ, or there is nothing finer."""
        # written so that an error that is not a number is refined
        return np.asarray((self.measures.errors[nodes] * share <= self.rules.threshold) | self.tree.is_leaf[nodes])

    # -- Algorithm 2 --------------------------------------------------------------------------------------------------

    def _answers(self) -> None:
        """Take the answers whose time has come; all of them if there is nothing else to do."""
        while self._asked and (not len(self._queue) or len(self._asked) > self.rules.lag):
            nodes, ticket = self._asked.popleft()
            samples = self.questions.result(ticket)
            share = self.measures.visibility(nodes, samples)
            self.samples[nodes], self.share[nodes] = samples, share
            seen = samples > 0
            if self.rules.trims:
                late = nodes[~seen & self.drawn[nodes]]
                self.drawn[late] = False
                self.trimmed += len(late)
            self._answered(nodes[seen], share[seen] if self.rules.by_visibility else np.ones(int(seen.sum())))

    def _answered(self, nodes: Ints, share: Floats) -> None:
        self._pull_up(nodes)
        stops = self._stops(nodes, share)
        early = self.drawn[nodes]
        again = nodes[early & ~stops]
        if len(again):
            # their children are as visible as they are themselves: they take their place without being asked first
            self.rarn += len(again)
            self.drawn[again] = False
            self.was_visible[self.tree.children_of(again)] = True
            self._refine(again)
        new = ~early & ~self.refined[nodes]
        self._draw(nodes[new & stops])
        self._refine(nodes[new & ~stops])

    def _pull_up(self, nodes: Ints) -> None:
        """A node is visible if something below it is."""
        while len(nodes):
            nodes = nodes[~self.visible[nodes]]
            self.visible[nodes] = True
            nodes = np.unique(self.tree.parent[nodes])
            nodes = nodes[nodes >= 0]

    # -- Algorithm 4 --------------------------------------------------------------------------------------------------

    def _draw(self, nodes: Ints) -> None:
        if len(nodes):
            self.drawn[nodes] = True
            self.questions.draw(nodes)

    def _refine(self, nodes: Ints) -> None:
        if len(nodes):
            self.refined[nodes] = True
            self._schedule(self.tree.children_of(nodes))
