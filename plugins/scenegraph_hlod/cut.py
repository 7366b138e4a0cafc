"""The nodes that a frame draws, and what is remembered of them for the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenegraph.meshes import Hlod

from .measures import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class HlodCut:
    """What the stage found in one frame.

    Attributes
    ----------
    tree : Hlod
    nodes : (k,) int64
        Drawn nodes, ascending. No leaf is below two of them.
    errors : (m,) float64
        ε of all nodes in pixels.
    share : (m,) float64
        μ = q / α as it was measured last, in this frame or before; NaN where never.
    samples : (m,) int64
        q of the nodes that were asked in this frame, -1 for the others.
    visible, visited : (m,) bool
        Nodes that were found visible, and that were looked at, in this frame.
    scheduled : int
        Nodes that were scheduled in this frame: S of the next.
    index : int
        Of the frame.
    """

    tree: Hlod
    nodes: Ints
    errors: Floats
    share: Floats
    samples: Ints
    visible: Bools
    visited: Bools
    scheduled: int
    index: int

    @property
    def correction(self) -> Floats:
        """(k,) how much occlusion has lowered the error of each drawn node: 0 not at all, 1 to nothing."""
        share = self.share[self.nodes]
        return np.where(np.isnan(share), 0.0, 1.0 - share)
