"""Hierarchical view-frustum culling.

Clark, "Hierarchical geometric models for visible surface algorithms", CACM 19(10), 1976: a subtree whose bound lies
outside the view is skipped, one whose bound lies inside is not asked again. The box-against-plane test looks at the one
corner that decides (Assarsson & Möller, "Optimized view frustum culling algorithms", 2000), for all boxes in one matrix
product. What we add: boxes that are outside no single plane are also tested against the frustum's own bounding box,
because large boxes beside a corner of the frustum pass all six planes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import IN, Batch, Frame, Guarantee, Stage
from scenegraph.kernels.boxes import box_planes


class Frustum(Stage):
    """Hides what lies wholly outside the view frustum."""

    name = "frustum"
    guarantee = Guarantee.CONSERVATIVE

    def run(self, frame: Frame) -> None:
        """Classify the hierarchy against the six planes, then against the frustum's bounding box."""
        view, origin = frame.view, frame.snapshot.origin
        planes = view.planes(origin)
        around = box_planes(*view.bounds(origin))

        def classify(batch: Batch) -> NDArray[np.int8]:
            outside = batch.outside(planes)
            left = (~outside).nonzero()[0]
            outside[left] = batch.outside(around, left)
            # OUT and PARTIAL are False and True
            verdict = np.logical_not(outside).view(np.int8)
            if not batch.is_rows:
                verdict[batch.inside(planes)] = IN
            return verdict

        frame.traverse(classify)
