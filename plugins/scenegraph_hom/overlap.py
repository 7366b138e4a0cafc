"""The overlap test: whether all of an occludee's rectangle is closed, and by what is in front of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from scenegraph.kernels.pyramids import (
    map_cell_texels,
)
from scenegraph.kernels.rectangles import (
    rect_area,
    rect_cells_pass,
    rect_count_above,
    rect_minimum,
    rect_sums,
)

from .products import Footprint, OcclusionMap
from .shapes import I64

Codes = NDArray[np.uint16]
Judge = Callable[[I64, Codes], NDArray[np.bool_]]


def hidden_exactly(
    occlusion: OcclusionMap, footprint: Footprint, *, opacity: float, compared: bool
) -> NDArray[np.bool_]:
    """By a summed-area table and minima over windows: four reads each, and nothing but the rectangle is looked at.

    Parameters
    ----------
    occlusion : OcclusionMap
    footprint : Footprint
    opacity : float
        Part of the rectangle's texels that must be closed, by something in front if depths are compared.
    compared : bool
        Compare depths; otherwise every occluder is taken to be in front.

    Returns
    -------
    (k,) bool
        False where the footprint cannot be tested.
    """
    return _where_testable(footprint, lambda t, c: _pass_exactly(occlusion, t, c, opacity, compared=compared))


def hidden_by_cells(
    occlusion: OcclusionMap, footprint: Footprint, *, opacity: float, compared: bool, descents: int
) -> NDArray[np.bool_]:
    """By the pyramid, as in the thesis: cells around the rectangle, at most four; those that fail are opened.

    Parameters
    ----------
    occlusion, footprint, compared
        As in `hidden_exactly`.
    opacity : float
        Part of each cell's texels that must be closed (Zhang's threshold).
    descents : int
    """
    counts = occlusion.counts
    full = [map_cell_texels(occlusion.size, k) for k in range(len(counts))]
    passes = [count >= np.ceil(opacity * n - 1e-9) for count, n in zip(counts, full, strict=True)]
    hopeless = [count == 0 for count in counts]

    def judge(texels: I64, codes: Codes) -> NDArray[np.bool_]:
        least = occlusion.farthest_pyramid if compared else None
        return rect_cells_pass(passes, texels, descents=descents, hopeless=hopeless, least=least, codes=codes)

    return _where_testable(footprint, judge)


def _where_testable(footprint: Footprint, judge: Judge) -> NDArray[np.bool_]:
    hidden = np.zeros(len(footprint.codes), bool)
    if footprint.testable.all():
        return judge(footprint.texels, footprint.codes) if len(hidden) else hidden
    testable = np.flatnonzero(footprint.testable)
    if len(testable):
        hidden[testable] = judge(footprint.texels[:, testable], footprint.codes[testable])
    return hidden


def _pass_exactly(
    occlusion: OcclusionMap, texels: I64, codes: Codes, opacity: float, *, compared: bool
) -> NDArray[np.bool_]:
    if compared and opacity == 1.0:
        # an open texel has code 0, and nothing is behind that
        return np.asarray(rect_minimum(occlusion.codes, texels) > codes)
    area = rect_area(texels)
    # the slack keeps (1 - 0.9) · 10 at one texel, and full opacity at none
    allowed = np.floor((1.0 - opacity) * area + 1e-9)
    closed = rect_sums(occlusion.sums, texels)
    passed = (area - closed <= allowed) & (closed > 0)
    if compared:
        # most are hidden wholly; the others are counted texel by texel, because each compares with a depth of its own
        left = np.flatnonzero(passed)
        left = left[rect_minimum(occlusion.codes, texels[:, left]) <= codes[left]]
        in_front = rect_count_above(occlusion.codes, texels[:, left], codes[left])
        passed[left] = (area[left] - in_front <= allowed[left]) & (in_front > 0)
    return np.asarray(passed)
