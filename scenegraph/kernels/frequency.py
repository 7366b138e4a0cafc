"""The four lowest coefficients of the discrete cosine transform of many blocks at once, and the level of visibility.

Kristmann 2022, section 3.5: the block of the occlusion map under an occludee's rectangle is transformed, and what lies
in its lowest frequencies says how large the holes are through which the occludee can be seen.

Eq. 3.2 prints α(x) = 1/√x for x ≥ 0; meant is the frequency: α(0) = 1/√N and α(u > 0) = √(2/N), the orthonormal
DCT-II. Eq. 3.3 is ``LV = F(0,0) - (|F(1,0)| + |F(0,1)| + |F(1,1)|)``, whose text calls these three the highest
frequencies; they are the lowest that are not constant. LV has the scale of the block: full coverage gives ½·P·√(N·M)
for opacities in [-P/2, P/2]. We divide by that. The least value is not -1 (a block of which a quarter is covered
reaches about -1.8): we clamp.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .pyramids import map_cell_texels
from .rectangles import Rects, rect_level

#: Longest side of a block, in cells.
BLOCK = 16

#: How many levels below that of eq. 3.1 the block is taken: its longer side then has 8 to 16 cells.
BELOW = 4

#: Blocks that are transformed together: their rows stay in the second-level cache.
BLOCKS_AT_ONCE = 512

#: Texels that are counted one by one in cells that are in front of their occludee in part.
TEXELS = 1 << 22


def block_basis(length: int, /) -> NDArray[np.float64]:
    """(2, BLOCK) rows α(u)·cos(π u (2 i + 1) / 2N) for u = 0, 1 and N = `length`; 0 beyond the block."""
    basis = np.zeros((2, BLOCK))
    i = np.arange(length)
    basis[0, :length] = 1 / np.sqrt(length)
    basis[1, :length] = np.sqrt(2 / length) * np.cos(np.pi * (2 * i + 1) / (2 * length))
    if length == 1:
        # cos(π/2) in floating point is not quite 0
        basis[1] = 0.0
    return basis


_BASES = np.stack([np.zeros((2, BLOCK))] + [block_basis(n) for n in range(1, BLOCK + 1)])
#: By length: (BLOCK, 3) cosines and ones, 0 beyond the block; and (BLOCK, 2) cosines.
_ROW_BASES = np.concatenate(
    [_BASES, (np.arange(BLOCK) < np.arange(BLOCK + 1)[:, None, None]).astype(np.float64)], axis=1
).transpose(0, 2, 1)
_COLUMN_BASES = np.ascontiguousarray(_BASES.transpose(0, 2, 1))


def rect_blocks(rects: Rects, /, *, levels: int) -> tuple[NDArray[np.int64], Rects]:
    """The block of cells under each rectangle.

    Parameters
    ----------
    rects : (4, k) int64
        Texels, not empty.
    levels : int
        Number of levels of the pyramid.

    Returns
    -------
    level : (k,) int64
        Four below that of eq. 3.1, at least 0.
    cells : (4, k) int64
        Cells x0, y0, x1, y1 of that level, half open; at most BLOCK on a side. A rectangle that straddles one cell more
        loses its last.
    """
    level = np.clip(rect_level(rects) - BELOW, 0, levels - 1)
    cells = np.empty_like(rects)
    cells[:2] = rects[:2] >> level
    cells[2:] = np.minimum(-(-rects[2:] >> level), cells[:2] + BLOCK)
    return level, cells


def block_coefficients(
    image: NDArray[np.float64],
    cells: Rects,
    /,
    *,
    depths: tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.uint16]] | None = None,
    texels: tuple[NDArray[np.uint16], int] | None = None,
    most_texels: int = TEXELS,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """F(0,0), F(1,0), F(0,1), F(1,1) of blocks of an image: u counts along x, v along y.

    Parameters
    ----------
    image : (h, w) float64
    cells : (4, k) int64
        x0, y0, x1, y1, half open, 1 to BLOCK on a side.
    depths : (h, w) uint16, (h, w) uint16, (k,) uint16, optional
        Least and greatest nearness code of what covers each cell, and the code of each block's occludee. The image
        holds opacities less ½: what is not in front of the occludee is then taken as -½, and a cell that is in front of
        it in part counts by half.
    texels : (h', w') uint16 and int, optional
        With `depths`: the nearness codes of all texels, of which 2**level by 2**level make a cell, and that level.
        Cells that are in front in part are then counted texel by texel.
    most_texels : int
        When so many have been looked at, the rest counts by half again.

    Returns
    -------
    coefficients : (4, k) float64
    total : (k,) float64
        Plain sum over the block; exact where the values are multiples of a power of two.
    """
    stride = image.shape[1] + BLOCK - 1
    # rows of 16 cells, whatever the block's width: a gather of contiguous runs
    runs = _runs(image)
    across = cells[2] - cells[0]
    order = np.argsort(across.astype(np.uint8), kind="stable")
    x0, y0, x1, y1 = cells[:, order]
    across, down = x1 - x0, y1 - y0
    corner = y0 * stride + x0
    if depths is not None:
        least, most, codes = _runs(depths[0]), _runs(depths[1]), depths[2][order]
    looked_at = 0
    out = np.empty((5, len(order)))
    for a in range(0, len(order), BLOCKS_AT_ONCE):
        part = slice(a, a + BLOCKS_AT_ONCE)
        count = down[part]
        begin = np.cumsum(count) - count
        line = np.arange(int(count.sum())) - np.repeat(begin, count)
        place = line * stride + np.repeat(corner[part], count)
        rows = runs[place]
        if depths is not None:
            code = np.repeat(codes[part], count)[:, None]
            behind = least[place] <= code
            # ½·(opacity) - ½ where some of it is in front, -½ where nothing is
            np.multiply(rows, 0.5, out=rows, where=behind)
            np.subtract(rows, 0.25, out=rows, where=behind)
            front = most[place] > code
            rows[~front] = -0.5
            if texels is not None and looked_at < most_texels:
                partly = behind & front & (np.arange(BLOCK) < np.repeat(across[part], count)[:, None])
                row, column = np.nonzero(partly)
                y, x = np.divmod(place[row], stride)
                rows[row, column] = _share_above(*texels, x + column, y, code[row, 0]) - 0.5
                looked_at += len(row) << (2 * texels[1])
        out[:, order[part]] = _low_terms(rows, begin, line, across[part], count)
    return out[:4], out[4]


def _share_above(
    values: NDArray[np.uint16], level: int, x: NDArray[np.int64], y: NDArray[np.int64], codes: NDArray[np.uint16]
) -> NDArray[np.float64]:
    """(k,) part of the texels of cells (x, y) of a level that have values above a code each."""
    side = 1 << level
    height, width = values.shape
    out = np.empty(len(x))
    step = np.arange(side)
    at_once = max((1 << 20) >> (2 * level), 1)
    for a in range(0, len(x), at_once):
        some = slice(a, a + at_once)
        across, down = (x[some, None] << level) + step, (y[some, None] << level) + step
        within = (down < height)[:, :, None] & (across < width)[:, None, :]
        flat = np.minimum(down, height - 1)[:, :, None] * width + np.minimum(across, width - 1)[:, None, :]
        above = (values.reshape(-1).take(flat) > codes[some, None, None]) & within
        out[some] = np.count_nonzero(above, axis=(1, 2)) / np.count_nonzero(within, axis=(1, 2))
    return out


def _runs(image: NDArray[np.generic]) -> NDArray[np.generic]:
    """(n, BLOCK) overlapping runs of the image's cells, row after row, each row followed by BLOCK - 1 zeros."""
    padded = np.zeros((image.shape[0], image.shape[1] + BLOCK - 1), image.dtype)
    padded[:, : image.shape[1]] = image
    return np.lib.stride_tricks.sliding_window_view(padded.reshape(-1), BLOCK)


def _low_terms(
    rows: NDArray[np.float64],
    begin: NDArray[np.int64],
    line: NDArray[np.int64],
    across: NDArray[np.int64],
    down: NDArray[np.int64],
) -> NDArray[np.float64]:
    """(5, k) coefficients and plain sums of blocks sorted by width, given the rows of all of them."""
    along = np.empty((len(rows), 3))
    begins = np.append(begin, len(rows))
    start = 0
    while start < len(across):
        width = int(across[start])
        stop = int(np.searchsorted(across, width, side="right"))
        inside = slice(begins[start], begins[stop])
        np.matmul(rows[inside], _ROW_BASES[width], out=along[inside])
        start = stop
    upward = _COLUMN_BASES[np.repeat(down, down), line]
    terms = np.empty((5, len(rows)))
    np.multiply(along[:, 0], upward[:, 0], out=terms[0])
    np.multiply(along[:, 1], upward[:, 0], out=terms[1])
    np.multiply(along[:, 0], upward[:, 1], out=terms[2])
    np.multiply(along[:, 1], upward[:, 1], out=terms[3])
    terms[4] = along[:, 2]
    return np.asarray(np.add.reduceat(terms, begin, axis=1))


def block_visibility(
    coefficients: NDArray[np.float64], total: NDArray[np.float64], cells: Rects, /
) -> NDArray[np.float64]:
    """Level of visibility in [-1, 1]: 1 where the block is covered, -1 where nothing covers it, both exactly.

    Parameters
    ----------
    coefficients, total
        From `block_coefficients` of opacities less ½.
    cells : (4, k) int64
    """
    f00, f10, f01, f11 = coefficients
    area = (cells[2] - cells[0]) * (cells[3] - cells[1])
    value = (f00 - (np.abs(f10) + np.abs(f01) + np.abs(f11))) / (0.5 * np.sqrt(area))
    value = np.clip(value, -1.0, 1.0)
    # a constant block's other coefficients are 0 but for rounding
    value[total == 0.5 * area] = 1.0
    value[total == -0.5 * area] = -1.0
    return np.asarray(value)


def rect_visibility(
    counts: Sequence[NDArray[np.signedinteger]],
    rects: Rects,
    /,
    *,
    depths: tuple[Sequence[NDArray[np.uint16]], Sequence[NDArray[np.uint16]], NDArray[np.uint16]] | None = None,
    texels: NDArray[np.uint16] | None = None,
) -> NDArray[np.float64]:
    """Level of visibility of rectangles over a pyramid of covered texels (eq. 3.2 and 3.3, normalized and clamped).

    Parameters
    ----------
    counts : list of (rows, columns) int
        From `map_count_pyramid`.
    rects : (4, k) int64
        Texels, not empty.
    depths : pyramid, pyramid, (k,) uint16, optional
        Least and greatest nearness code of what covers each cell, level by level, and the codes of the occludees: only
        what is in front of an occludee counts. Kristmann 2022 takes it that everything is.
    texels : (h, w) uint16, optional
        Codes of all texels: see `block_coefficients`.

    Returns
    -------
    (k,) float64
    """
    out = np.empty(rects.shape[1])
    level, cells = rect_blocks(rects, levels=len(counts))
    size = (counts[0].shape[1], counts[0].shape[0])
    for k in np.unique(level).tolist():
        chosen = np.flatnonzero(level == k)
        image = counts[k] / map_cell_texels(size, k) - 0.5
        here = None if depths is None else (depths[0][k], depths[1][k], depths[2][chosen])
        finest = None if texels is None else (texels, k)
        coefficients, total = block_coefficients(image, cells[:, chosen], depths=here, texels=finest)
        out[chosen] = block_visibility(coefficients, total, cells[:, chosen])
    return out
