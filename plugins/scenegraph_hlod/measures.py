"""What a view says about the nodes of a tree before anything is asked: errors in pixels, sizes, distances.

Section 4 of the paper: ε is the model error projected at the node's nearest point (2.1.1); α the pixels of the node's
box (4.3); μ = q / α the part of them that is visible, so that ε^q = ε · μ (4.2).

What we changed: α is by default the exact number of pixels of the box on the screen. The paper's estimate from a cube
of the same volume is 0 for a flat box, and does not know the border of the screen: `alpha="cube"`. μ is clamped to
[0, 1], and 1 where α is at or below one pixel, or unknown.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, View
from scenegraph.kernels.areas import box_cube_area, box_pixel_area
from scenegraph.kernels.boxes import box_outside_exact
from scenegraph.meshes import Hlod

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Alpha = Literal["projected", "cube"]


class Measures:
    """The nodes of a tree in one view.

    Attributes
    ----------
    outside : (m,) bool
        Nodes that are not entered: outside the view frustum, or all their rows are hidden already.
    errors : (m,) float64
        ε in pixels; 0 at leaves.
    area : (m,) float64
        α in pixels; NaN where unknown.
    counts : (m,) bool
        Nodes whose μ depends on what is in front of them; for the others it is 1: α is at or below a pixel or unknown,
        as for a box around the eye or across the near plane.
    distance : (m,) float64
        From the eye to the nearest point of each box, in world units.
    """

    def __init__(self, tree: Hlod, frame: Frame, alpha: Alpha) -> None:
        view = frame.view
        self.tree = tree
        self.outside = box_outside_exact(tree.boxes, view.planes(view.eye), origin=np.asarray(view.eye))
        self.outside |= _dead(tree, frame)
        self.errors = np.where(tree.is_leaf, 0.0, view.error_pixels(tree.errors, tree.boxes))
        exact = _area(view, tree.boxes, "projected")
        self.area = exact if alpha == "projected" else _area(view, tree.boxes, alpha)
        # the exact one is not a number where a box cannot be asked
        self.counts = ~np.isnan(exact) & (self.area > 1.0)
        gap = np.abs(tree.boxes[:3] - np.asarray(view.eye)[:, None]) - tree.boxes[3:]
        self.distance = np.linalg.norm(np.maximum(gap, 0.0), axis=0)

    def visibility(self, nodes: Ints, samples: Ints) -> Floats:
        """(k,) μ of nodes of which so many samples are visible."""
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.minimum(samples / self.area[nodes], 1.0)
        # nothing visible is nothing, however small the box is
        return np.where(samples == 0, 0.0, np.where(self.counts[nodes], share, 1.0))


def _area(view: View, boxes: Floats, alpha: Alpha) -> Floats:
    eye = np.asarray(view.eye)
    if alpha == "cube":
        at_one = float(view.pixels_per_unit(1.0))
        return box_cube_area(boxes, eye=eye, pixels_at_one=at_one, parallel=view.is_parallel)
    return box_pixel_area(
        boxes,
        axes=view.axes,
        eye=eye,
        window=view.window,
        size=(view.width, view.height),
        near=view.near,
        parallel=view.is_parallel,
    )


def _dead(tree: Hlod, frame: Frame) -> Bools:
    """(m,) nodes below which every row is hidden."""
    if frame.visible[tree.covered].all():
        return np.zeros(len(tree), bool)
    shown = np.concatenate([[0], np.cumsum(frame.visible[tree.leaf_rows])])
    alive = np.concatenate([[0], np.cumsum(np.diff(shown[tree.leaf_row_start]) > 0)])
    return np.asarray(alive[tree.first_leaf[tree.end]] == alive[tree.first_leaf[:-1]])
