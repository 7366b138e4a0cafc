"""What the viewer can show of the stage: how much of each drawable can be seen, and the map that says so.

The colors are those of Figures 4.3 and 4.4 of Kristmann 2022: occluders red, the others blue, the paler the less can be
seen of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, LevelOfVisibility, Overlay
from scenegraph.kernels.slices import slice_expand

from .products import OcclusionMap

Color = tuple[float, float, float]

OCCLUDER: Color = (0.80, 0.20, 0.16)
#: Level of visibility -1, all of it can be seen, to 1.
DARK: Color = (0.05, 0.16, 0.45)
PALE: Color = (0.80, 0.92, 1.00)
#: In the inset: what is picked, and the block that its level of visibility is made of.
PICKED, BLOCK = (255, 96, 64), (64, 160, 255)
#: Longest side of the inset's map, and height of the strip with block and coefficients.
WIDTH, STRIP = 512, 128


class ByVisibility(Overlay):
    """Occluders red; the others blue, the paler the less of them can be seen."""

    name = "level of visibility"
    stage = "hom"
    key = "v"

    def colors(self, frame: Frame) -> NDArray[np.float64] | None:
        """One color per row; what is hidden is not drawn."""
        visibility, occlusion = frame.find(LevelOfVisibility), frame.find(OcclusionMap)
        if visibility is None or occlusion is None:
            return None
        share = 0.5 * (np.clip(visibility.values, -1.0, 1.0)[:, None] + 1.0)
        colors = (1 - share) * np.array(DARK) + share * np.array(PALE)
        colors[occluding_rows(frame, occlusion)] = OCCLUDER
        return np.column_stack([colors, frame.visible])

    def legend(self, frame: Frame) -> list[tuple[str, Color]]:
        """Occluders, and both ends of the scale."""
        occlusion = frame.find(OcclusionMap)
        if occlusion is None:
            return []
        middle = (0.5 * (DARK[0] + PALE[0]), 0.5 * (DARK[1] + PALE[1]), 0.5 * (DARK[2] + PALE[2]))
        return [
            (f"occluders: {len(occlusion.rows) + len(occlusion.declared):,}", OCCLUDER),
            ("visible in full, -1", DARK),
            ("0", middle),
            ("covered, 1", PALE),
        ]


class MapInset(Overlay):
    """The occlusion map; with the rectangle, the block and the coefficients of what is picked."""

    name = "occlusion map"
    stage = "hom"
    key = "n"

    def inset(self, frame: Frame) -> NDArray[np.uint8] | None:
        """The map, and below it the picked drawable's block and the four coefficients, largest magnitude to the top."""
        occlusion = frame.find(OcclusionMap)
        if occlusion is None:
            return None
        width, height = occlusion.size
        step = max(-(-max(width, height) // WIDTH), 1)
        # what is open stays open when every few texels are shown as one
        shown = np.minimum.reduceat(
            np.minimum.reduceat(occlusion.covered, np.arange(0, height, step), axis=0),
            np.arange(0, width, step),
            axis=1,
        )
        picture = np.repeat(np.where(shown, 255, 30).astype(np.uint8)[..., None], 3, axis=2)
        row = self.picked
        if row is None or row >= frame.snapshot.n:
            return picture[::-1]
        box = frame.snapshot.boxes[:, row]
        texels, _, testable = occlusion.footprint(box.reshape(6, 1))
        block = occlusion.block(box)
        if block is None or not testable[0]:
            return picture[::-1]
        _outline(picture, [c << block.level for c in block.cells], step, BLOCK)
        _outline(picture, texels[:, 0].tolist(), step, PICKED)
        return np.concatenate([picture[::-1], _strip(block.opacity, block.coefficients, picture.shape[1])])


def occluding_rows(frame: Frame, occlusion: OcclusionMap) -> NDArray[np.int64]:
    """Rows that are drawn on the map, or that a declared occluder on it stands for."""
    first, end = frame.snapshot.occluders.owner[occlusion.declared].T if len(occlusion.declared) else ([], [])
    return np.concatenate([occlusion.rows, slice_expand(np.asarray(first, np.int64), np.asarray(end, np.int64))])


def _outline(picture: NDArray[np.uint8], rect: list[int], step: int, color: tuple[int, int, int]) -> None:
    """Draw the border of a rectangle of texels, row 0 at the bottom."""
    height, width = picture.shape[:2]
    x0, y0 = min(max(rect[0] // step, 0), width - 1), min(max(rect[1] // step, 0), height - 1)
    x1 = min(max((rect[2] - 1) // step, x0), width - 1)
    y1 = min(max((rect[3] - 1) // step, y0), height - 1)
    picture[[y0, y1], x0 : x1 + 1] = color
    picture[y0 : y1 + 1, [x0, x1]] = color


def _strip(opacity: NDArray[np.float64], coefficients: tuple[float, ...], width: int) -> NDArray[np.uint8]:
    """(STRIP, width, 3) the block's cells as squares, and a bar up or down for each coefficient."""
    strip = np.full((STRIP, width, 3), 60, np.uint8)
    rows, columns = opacity.shape
    size = max(min((STRIP - 8) // rows, (width // 2 - 8) // columns), 1)
    cells = np.kron(opacity[::-1], np.ones((size, size)))[: STRIP - 8, : width // 2]
    strip[4 : 4 + cells.shape[0], 4 : 4 + cells.shape[1]] = np.round(255 * cells)[..., None]
    start, middle = width // 2 + 8, STRIP // 2
    wide = max((width - start - 8) // 4, 2)
    # a block that is covered or open has ½ √(cells) as its only coefficient: no bar is longer
    longest = 0.5 * np.sqrt(opacity.size)
    for number, value in enumerate(coefficients):
        tall = round((middle - 4) * min(abs(value) / longest, 1.0))
        x = start + number * wide
        bar = slice(middle - tall, middle) if value >= 0 else slice(middle, middle + tall)
        strip[bar, x : x + wide - 2] = PICKED if number == 0 else BLOCK
    strip[middle, start : start + 4 * wide - 2] = 160
    return strip
