"""What the stage hands to later stages: the occlusion map. The level of visibility that it puts is the host's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenegraph import View
from scenegraph.kernels.frequency import block_coefficients, block_visibility, rect_blocks, rect_visibility
from scenegraph.kernels.nearness import (
    NearnessScale,
    nearness_codes,
    nearness_depth,
    nearness_of,
)
from scenegraph.kernels.projection import box_screen_rectangles
from scenegraph.kernels.pyramids import (
    map_cell_texels,
    map_count_pyramid,
    map_maximum_pyramid,
    map_minimum_pyramid,
    map_sums,
)
from scenegraph.kernels.rectangles import (
    rect_area,
    rect_texels,
)


class Footprint(NamedTuple):
    """Where boxes lie on the map.

    Attributes
    ----------
    texels : (4, k) int64
        Touched texels x0, y0, x1, y1, half open.
    codes : (k,) uint16
        Nearness code of the nearest point.
    testable : (k,) bool
        The box does not reach the near plane, and some of its rectangle is on the map.
    """

    texels: NDArray[np.int64]
    codes: NDArray[np.uint16]
    testable: NDArray[np.bool_]


class Block(NamedTuple):
    """How the level of visibility of one rectangle comes about (Figure 3.4 of the thesis).

    Attributes
    ----------
    level : int
        Pyramid level of the cells.
    cells : 4 ints
        x0, y0, x1, y1, half open, in cells of that level.
    opacity : (h, w) float64
        Covered part of each cell; row 0 is the lowest.
    coefficients : 4 floats
        F(0,0), F(1,0), F(0,1), F(1,1) of opacities less ½.
    visibility : float
        Level of visibility.
    """

    level: int
    cells: tuple[int, int, int, int]
    opacity: NDArray[np.float64]
    coefficients: tuple[float, float, float, float]
    visibility: float


@dataclass(frozen=True)
class OcclusionMap:
    """Occluders of a frame, fused in image space.

    Arrays have row 0 at the bottom, as pixel coordinates have; `picture` has the top row first. Pyramids and sums are
    made when they are first asked for.

    Attributes
    ----------
    view : View
        Its image is what the map covers, whatever the map's own aspect.
    codes : (h, w) uint16
        Nearness code of the farthest point at which a texel is closed; 0 where it is open.
    scale : NearnessScale
    rows : (k,) int64
        Drawables that were drawn as occluders.
    declared : (j,) int64
        Indices of declared occluders that were drawn.
    strict : bool
        Closed texels are wholly covered; otherwise their centers are.
    redraw : callable, optional
        Makes `codes` of the same occluders by centers.
    """

    view: View
    codes: NDArray[np.uint16]
    scale: NearnessScale
    rows: NDArray[np.int64]
    declared: NDArray[np.int64]
    strict: bool
    redraw: Callable[[], NDArray[np.uint16]] | None = None

    @cached_property
    def by_centers(self) -> OcclusionMap:
        """The map whose texels are closed where their centers are covered: strict coverage makes every hole larger."""
        if not self.strict or self.redraw is None:
            return self
        return replace(self, codes=self.redraw(), strict=False, redraw=None)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in texels."""
        return self.codes.shape[1], self.codes.shape[0]

    @cached_property
    def covered(self) -> NDArray[np.bool_]:
        """(h, w) closed texels."""
        return np.asarray(self.codes > 0)

    @cached_property
    def sums(self) -> NDArray[np.signedinteger]:
        """(h + 1, w + 1) summed-area table of `covered`."""
        return map_sums(self.covered)

    @cached_property
    def counts(self) -> list[NDArray[np.signedinteger]]:
        """Pyramid of covered texels."""
        return map_count_pyramid(self.covered)

    @cached_property
    def farthest(self) -> NDArray[np.uint16]:
        """(h, w) codes, with the highest where nothing covers: the minimum over a rectangle is that of what does."""
        return np.where(self.covered, self.codes, np.uint16(65535))

    @cached_property
    def farthest_pyramid(self) -> list[NDArray[np.uint16]]:
        """Least code of what covers each cell."""
        return map_minimum_pyramid(self.farthest)

    @cached_property
    def nearest_pyramid(self) -> list[NDArray[np.uint16]]:
        """Greatest code of what covers each cell; 0 if nothing does."""
        return map_maximum_pyramid(self.codes)

    def depth(self) -> NDArray[np.float64]:
        """(h, w) depth bound of each texel: what is farther is hidden; +∞ where nothing can be."""
        return nearness_depth(self.codes, self.scale)

    def picture(self) -> NDArray[np.uint8]:
        """(h, w) closed texels white, top row first, as the thesis prints its maps."""
        return np.where(self.covered[::-1], np.uint8(255), np.uint8(0))

    def footprint(self, boxes: NDArray[np.float64]) -> Footprint:
        """Where world boxes (6, k) lie on the map."""
        view = self.view
        rects, depth, crossing = box_screen_rectangles(
            boxes,
            axes=view.axes,
            eye=np.asarray(view.eye),
            window=view.window,
            size=self.size,
            near=view.near,
            parallel=view.is_parallel,
            clip=False,
        )
        texels = rect_texels(rects, size=self.size)
        with np.errstate(divide="ignore", invalid="ignore"):
            nearness = nearness_of(depth, parallel=view.is_parallel)
            codes = nearness_codes(nearness, self.scale, occludee=True)
        return Footprint(texels, codes, ~crossing & (rect_area(texels) > 0))

    def block(self, box: NDArray[np.float64]) -> Block | None:
        """How the level of visibility of one world box (6,) comes about; None where it cannot be told."""
        if self.by_centers is not self:
            return self.by_centers.block(box)
        texels, codes, testable = self.footprint(np.asarray(box, np.float64).reshape(6, 1))
        if not testable[0]:
            return None
        levels, cells = rect_blocks(texels, levels=len(self.counts))
        level = int(levels[0])
        image = self.counts[level] / map_cell_texels(self.size, level) - 0.5
        depths = self.farthest_pyramid[level], self.nearest_pyramid[level], codes
        coefficients, total = block_coefficients(image, cells, depths=depths, texels=(self.codes, level))
        x0, y0, x1, y1 = cells[:, 0].tolist()
        in_front = map_count_pyramid(self.codes > codes[0])[level] / map_cell_texels(self.size, level)
        opacity = in_front[y0:y1, x0:x1]
        f00, f10, f01, f11 = coefficients[:, 0].tolist()
        value = float(block_visibility(coefficients, total, cells)[0])
        return Block(level, (x0, y0, x1, y1), opacity, (f00, f10, f01, f11), value)


def map_visibility(
    drawn: OcclusionMap, texels: NDArray[np.int64], codes: NDArray[np.uint16] | None
) -> NDArray[np.float64]:
    """(k,) level of visibility under rectangles of texels.

    Parameters
    ----------
    drawn : OcclusionMap
    texels : (4, k) int64
    codes : (k,) uint16, or None
        Of the occludees; None takes every occluder to be in front.
    """
    depths = None if codes is None else (drawn.farthest_pyramid, drawn.nearest_pyramid, codes)
    return rect_visibility(drawn.counts, texels, depths=depths, texels=None if codes is None else drawn.codes)
