"""What the traversals share in one frame: the depth drawn so far, and the questions asked of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import OUT, PARTIAL, Batch, Frame
from scenegraph.kernels.slices import slice_expand

from .history import I64, NEVER, Mask, QueryHistory

F64 = NDArray[np.float64]


class Asking:
    """One frame of one view; to be used inside `frame.device.guard()`.

    Drawables are drawn by depth alone, each once, in the order in which a traversal finds them. Coarsened ones do not
    occlude, because their finest level would not be what is seen; translucent ones never do.

    Parameters
    ----------
    frame : Frame
    threshold : int
        A box is seen if it has more samples than this.
    supersample : int
        Samples of the query buffer per pixel and axis.
    margin : float
        Samples by which boxes are grown on the screen.
    due : (n,) bool
        Rows that are asked about in this frame although they were visible in the last.

    Attributes
    ----------
    before : QueryHistory
        Of the last frame.
    was : (n,) bool
        Candidates that were visible then.
    taken : (n,) bool
        Rows that were drawn, or would have been if they could occlude.
    hidden : (n,) bool
        Rows that an answer has hidden.
    asked : (n,) bool
        Rows that were asked about in this frame, or a node above them.
    """

    def __init__(self, frame: Frame, *, threshold: int, supersample: int, margin: float, due: Mask) -> None:
        self.frame, self.snapshot, self.view, self.device = frame, frame.snapshot, frame.view, frame.device
        self.threshold = threshold
        self._options = {"any_samples": threshold == 0, "margin": margin}
        self.tree = frame.snapshot.tree
        self.queries: Any = frame.device.queries
        self.target: Any = frame.device.depth_target(frame.view.width * supersample, frame.view.height * supersample)
        self.before = QueryHistory.before(frame)
        self._hide_outside()
        self.candidates: Mask = frame.visible.copy()
        self.was: Mask = self.before.visible & self.candidates
        #: Visible without being asked in this frame, as far as history goes.
        self.assumed: Mask = self.was & ~due
        n = frame.snapshot.n
        self.taken, self.hidden, self.asked = np.zeros(n, bool), np.zeros(n, bool), np.zeros(n, bool)
        self._occludes: Mask = frame.level == 0
        self._pending: list[I64] = []
        self._asked_boxes: list[F64] = []
        self._seen: list[Mask] = []
        self.passes = self.drawn = self.asked_count = 0
        self.distrusted = -int(self.queries.distrusted)
        self.target.clear()

    def _hide_outside(self) -> None:
        planes = self.view.planes(self.snapshot.origin)

        def classify(batch: Batch) -> NDArray[np.int8]:
            return np.where(batch.outside(planes), np.int8(OUT), np.int8(PARTIAL))

        self.frame.traverse(classify)

    # -- drawing ----------------------------------------------------------------------------------------------------

    def draw(self, rows: I64) -> None:
        """Draw rows that have not been drawn yet, at the latest when the next question is asked."""
        rows = rows[~self.taken[rows]]
        self.taken[rows] = True
        rows = rows[self._occludes[rows]]
        if len(rows):
            self._pending.append(rows)

    def flush(self) -> None:
        """Draw what waits to be drawn."""
        if self._pending:
            rows = np.concatenate(self._pending)
            self._pending.clear()
            self.device.draw_depth(self.target, self.view, self.snapshot, rows, clear=False)
            self.passes += 1
            self.drawn += len(rows)

    # -- asking -----------------------------------------------------------------------------------------------------

    def seen(self, boxes: F64) -> Mask:
        """(k,) whether boxes are seen, all asked at once."""
        if not boxes.shape[1]:
            return np.zeros(0, bool)
        self.flush()
        found = self.queries.count(self.view, boxes, self.target, **self._options)
        found = np.asarray(found > self.threshold)
        self.asked_count += len(found)
        self._note(boxes, found)
        return found

    def issue(self, boxes: F64, groups: I64 | None = None) -> Any:
        """A ticket for boxes, asked by one query object each, or each group by one."""
        self.flush()
        return self.queries.issue(self.view, boxes, self.target, groups=groups, **self._options)

    def answered(self, ticket: Any, boxes: F64, groups: I64 | None = None) -> Mask:
        """(g,) whether what a ticket of `issue` is about is seen; waits."""
        found = np.asarray(self.queries.result(ticket) > self.threshold)
        self.asked_count += len(ticket) - int(np.count_nonzero(ticket.unknown))
        self._note(boxes, found if groups is None else np.repeat(found, np.diff(groups)))
        return found

    def _note(self, boxes: F64, seen: Mask) -> None:
        self._asked_boxes.append(boxes)
        self._seen.append(seen)

    def hide_rows(self, rows: I64) -> None:
        """Rows whose boxes are not seen."""
        self.hidden[rows] = True
        self.asked[rows] = True

    def hide_nodes(self, nodes: I64) -> None:
        """All below nodes whose boxes are not seen."""
        self.hide_rows(slice_expand(self.tree.first[nodes], self.tree.end[nodes]))

    def ask_again(self) -> None:
        """Ask about all that was drawn, but for what is assumed, against the depth of everything that was drawn.

        What is not seen now has not contributed to that depth, so that nothing else depends on it.
        """
        rows = np.flatnonzero(self.taken & ~self.hidden & ~self.assumed & ~self.snapshot.protected)
        self.hide_rows(rows[~self.seen(self.snapshot.boxes[:, rows])])
        self.asked[rows] = True

    # -- ending -----------------------------------------------------------------------------------------------------

    def finish(self) -> None:
        """Hide what was found to be hidden, hand on the history, and log."""
        frame, before, index = self.frame, self.before, np.int32(self.frame.index)
        frame.hide(self.hidden & self.candidates)
        hidden = self.candidates & ~frame.visible
        asked_at = np.where(self.asked, index, before.asked_at)
        asked_at[~self.candidates] = NEVER
        boxes = np.concatenate([np.zeros((6, 0)), *self._asked_boxes], axis=1)
        seen = np.concatenate([np.zeros(0, bool), *self._seen])
        history = QueryHistory(
            int(index),
            visible=frame.visible.copy(),
            hidden_for=np.where(hidden, before.hidden_for + 1, 0).astype(np.int32),
            asked_at=asked_at.astype(np.int32),
            asked_boxes=boxes,
            seen=seen,
        )
        frame.put(history)
        ages = history.ages()[history.visible]
        frame.count(
            queries=self.asked_count,
            drawn=self.drawn,
            passes=self.passes,
            assumed=int(np.count_nonzero(ages > 0)),
            oldest_answer=int(ages.max(initial=0)),
            distrusted=self.distrusted + self.queries.distrusted,
            one_by_one=bool(self.queries.fallback),
        )
