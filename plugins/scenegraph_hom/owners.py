"""Declared occluders may never hide what their owners own, and a fused map does not say who hides what."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame
from scenegraph.kernels.slices import slice_expand

from .catalog import Catalog
from .products import OcclusionMap
from .scan import Drawn
from .shapes import I64


def owned_rows_kept(
    frame: Frame, catalog: Catalog, items: I64, drawn: Drawn, item_of: I64, occlusion: OcclusionMap
) -> NDArray[np.bool_]:
    """(n,) rows that an occluder of their own would help to hide.

    An owned row can only be behind its occluder where it is farther away than the occluder's nearest point, and that
    matters only where the occluder is the nearest thing on the map.

    Parameters
    ----------
    frame : Frame
    catalog : Catalog
    items : (m,) int64
        What was drawn.
    drawn : Drawn
    item_of : (i,) int64
        Position in `items` of each drawn instance.
    occlusion : OcclusionMap
    """
    kept = np.zeros(frame.snapshot.n, bool)
    owner = catalog.owner[items]
    owning = np.flatnonzero(owner[:, 1] > owner[:, 0])
    if not len(owning) or not len(drawn.instance):
        return kept
    rows = slice_expand(owner[owning, 0], owner[owning, 1])
    of = np.repeat(owning, owner[owning, 1] - owner[owning, 0])
    alive = frame.visible[rows]
    rows, of = rows[alive], of[alive]
    footprint = occlusion.footprint(frame.snapshot.boxes[:, rows])
    nearest = np.zeros(len(items), np.uint16)
    np.maximum.at(nearest, item_of[drawn.instance], drawn.piece_codes)
    behind = np.flatnonzero(footprint.testable & (nearest[of] > footprint.codes))
    if not len(behind):
        return kept
    asked = np.unique(of[behind])
    number = np.full(len(items), -1)
    number[asked] = np.arange(len(asked))
    wins = drawn.winning_rects(number[item_of], len(asked))[:, number[of[behind]]]
    x0, y0, x1, y1 = footprint.texels[:, behind]
    meets = (x0 < wins[2]) & (wins[0] < x1) & (y0 < wins[3]) & (wins[1] < y1)
    kept[rows[behind[meets]]] = True
    return kept
