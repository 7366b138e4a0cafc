"""Boxes of the hierarchy against the shadow frusta of a view."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scenegraph import IN, OUT, PARTIAL, Batch, Snapshot
from scenegraph.kernels.shadow_frusta import box_depth_in_frusta, box_touches_frusta, cone_rows_packed

from .frusta import Bools, Ints, ShadowFrusta

#: Occluders up to these numbers look at rows together: the first few hide most, the others see what is left.
CHUNKS = (4,)

#: Fewer nodes than these are opened without asking: the top of the tree is hidden by no single occluder.
FEW_NODES = 64


class Verdict:
    """Classifies boxes: OUT if one frustum holds all of a box, IN if none can hold anything in it.

    Parameters
    ----------
    snapshot : Snapshot
    frusta : ShadowFrusta

    Attributes
    ----------
    undecided : int
        Boxes that single precision could not tell.
    """

    def __init__(self, snapshot: Snapshot, frusta: ShadowFrusta) -> None:
        self._tree = snapshot.tree
        self._frusta = frusta
        pack = partial(cone_rows_packed, eye=frusta.eye, origin=snapshot.origin, radius=snapshot.radius)
        self._rows, margin = pack(frusta.rows)
        if len(frusta.holes):
            self._holes, more = pack(frusta.holes)
            margin = max(margin, more)
        self._unsure = -2.0 * margin
        self.undecided = 0

    def __call__(self, batch: Batch) -> NDArray[np.int8]:
        """(k,) verdicts of nodes or rows."""
        count = len(self._frusta)
        if batch.is_rows:
            left: Ints | None = None
            kept = np.ones(0, bool)
            for start, end in pairwise((0, *(c for c in CHUNKS if c < count), count)):
                hidden = self._hidden(batch, left, start, end)
                if left is None:
                    kept = ~hidden
                else:
                    kept[left[hidden]] = False
                left = kept.nonzero()[0] if end < count else left
            # False is OUT and True is PARTIAL
            return kept.view(np.int8)
        verdict = np.full(len(batch), PARTIAL, np.int8)
        if len(batch) >= FEW_NODES:
            verdict[~np.logical_or.reduce(box_touches_frusta(batch.packed, self._rows), axis=0)] = IN
            verdict[self._hidden(batch, None, 0, count)] = OUT
        return verdict

    def _hidden(self, batch: Batch, subset: Ints | None, start: int, end: int) -> Bools:
        """(j,) which boxes of the subset one of the frusta [start, end) hides."""
        frusta = self._frusta
        packed, index = batch.packed, batch.index
        if subset is not None:
            packed, index = packed.take(subset, axis=0), index.take(subset)
        depth = box_depth_in_frusta(packed, self._rows[start:end])
        if len(frusta.holes):
            self._subtract_holes(depth, packed, start, end)
        first, last = frusta.owner[start:end].T
        if batch.is_rows:
            # rows ascend: what an occluder may not hide is a slice of them, mostly of one row
            ends = index.searchsorted((first, last)).tolist()
            for deep, a, b in zip(depth, *ends, strict=True):
                deep[a:b] = -np.inf
        else:
            own = (self._tree.first[index] < last[:, None]) & (self._tree.end[index] > first[:, None])
            depth[own] = -np.inf
        deepest = np.maximum.reduce(depth, axis=0)
        hidden = deepest > 0.0
        if np.count_nonzero(deepest >= self._unsure) > np.count_nonzero(hidden):
            unsure = ((deepest >= self._unsure) & ~hidden).nonzero()[0]
            self.undecided += len(unsure)
            exact = frusta.hides(batch.boxes_at(unsure if subset is None else subset.take(unsure)))[start:end]
            hidden[unsure] = (exact & (depth[:, unsure] > -np.inf)).any(axis=0)
        return np.asarray(hidden)

    def _subtract_holes(self, depth: NDArray[np.float32], packed: NDArray[np.float32], start: int, end: int) -> None:
        which = ((self._frusta.hole_of >= start) & (self._frusta.hole_of < end)).nonzero()[0]
        if len(which):
            past = box_depth_in_frusta(packed, self._holes[which], any_plane=True)
            np.minimum.at(depth, self._frusta.hole_of[which] - start, past)
