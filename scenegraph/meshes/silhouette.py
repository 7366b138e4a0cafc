"""How much of a mesh's silhouette occluders cover, seen from many directions, in small bitmaps; which are worth it.

A pixel belongs to a shadow if its center does. Each direction has a bitmap of its own scale, as wide and as high as the
shadow of the mesh, so that plates and poles are resolved, too; only shares are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels.slices import slice_expand

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]


def directions(count: int) -> F64:
    """(count, 3) unit vectors spread evenly over half the sphere: opposite views see the same silhouette."""
    i = np.arange(count) + 0.5
    z = i / count
    turn = np.pi * (1 + np.sqrt(5)) * i
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def shadows(triangles: F64, groups: NDArray[np.int64], count: int, size: int) -> Mask:
    """Bitmaps of triangles in the plane.

    Parameters
    ----------
    triangles : (m, 3, 2) float64
        In pixels: the bitmap is [0, size]².
    groups : (m,) int
        Which bitmap each belongs to.
    count, size : int

    Returns
    -------
    (count, size, size) bool
        [group, y, x]
    """
    y = triangles[..., 1]
    first = np.clip(np.ceil(y.min(axis=1) - 0.5), 0, size).astype(np.int64)
    end = np.clip(np.floor(y.max(axis=1) - 0.5) + 1, first, size).astype(np.int64)
    lines = end - first
    owner = np.repeat(np.arange(len(lines)), lines)
    row = slice_expand(first, end)
    low, high = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for k in range(3):
        a, b = triangles[owner, k], triangles[owner, (k + 1) % 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (row + 0.5 - a[:, 1]) / (b[:, 1] - a[:, 1])
        x = np.where((share >= 0) & (share <= 1), a[:, 0] + share * (b[:, 0] - a[:, 0]), np.nan)
        low, high = np.fmin(low, x), np.fmax(high, x)
    # counts go up where a line of pixels begins and down after its end
    start = np.clip(np.ceil(low - 0.5), 0, size)
    stop = np.clip(np.floor(high - 0.5) + 1, 0, size)
    good = stop > start
    at = (groups[owner[good]] * size + row[good]) * (size + 1)
    change = np.bincount(at + start[good].astype(np.int64), minlength=count * size * (size + 1))
    change -= np.bincount(at + stop[good].astype(np.int64), minlength=count * size * (size + 1))
    return np.asarray(change.reshape(count, size, size + 1).cumsum(axis=2)[..., :size] > 0)


@dataclass(frozen=True)
class Silhouette:
    """Shadows of a mesh, and what measures the share of them that something else covers.

    Attributes
    ----------
    frames : (d, 3, 3) float64
        Rows are right, up, and toward the viewer, of each direction.
    low, scale : (d, 2) float64
        Pixels are (position - low) * scale.
    bitmaps : (d, size, size) bool
    """

    frames: F64
    low: F64
    scale: F64
    bitmaps: Mask

    @classmethod
    def of(cls, triangles: F64, *, views: int, size: int) -> Silhouette:
        """Of triangles (m, 3, 3), from `views` directions and their opposites."""
        toward = directions(views)
        helper = np.eye(3)[np.abs(toward).argmin(axis=1)]
        right = np.cross(helper, toward)
        right /= np.linalg.norm(right, axis=1)[:, None]
        frames = np.stack([right, np.cross(toward, right), toward], axis=1)
        lows, scales, maps = [], [], []
        group = np.zeros(len(triangles), np.int64)
        for frame in frames:
            flat = triangles @ frame[:2].T
            low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
            scale = size / np.maximum(high - low, 1e-300)
            lows.append(low)
            scales.append(scale)
            maps.append(shadows((flat - low) * scale, group, 1, size)[0])
        return cls(frames, np.array(lows), np.array(scales), np.array(maps))

    @property
    def pixels(self) -> NDArray[np.int64]:
        """(d,) pixels of the silhouette in each direction."""
        return np.asarray(self.bitmaps.sum(axis=(1, 2)))

    def covered(self, shapes: Sequence[F64]) -> Mask:
        """(c, d, size, size) what each of some shapes, given as triangles (m, 3, 3), covers of the silhouette."""
        size = self.bitmaps.shape[1]
        out = np.zeros((len(shapes), *self.bitmaps.shape), bool)
        if not len(shapes):
            return out
        groups = np.repeat(np.arange(len(shapes)), [len(s) for s in shapes])
        triangles = np.concatenate(list(shapes))
        for k, frame in enumerate(self.frames):
            flat = (triangles @ frame[:2].T - self.low[k]) * self.scale[k]
            out[:, k] = shadows(flat, groups, len(shapes), size) & self.bitmaps[k]
        return out


class Tally:
    """What occluders cover together, and what each new one adds; all views and their opposites count alike.

    Parameters
    ----------
    silhouette : Silhouette
    bits : (c, d, size, size) bool
        What each candidate covers, see `Silhouette.covered`.
    fronts : (c, 3) float64
        The direction from which a candidate can be seen; 0 for any.
    after : Tally, optional
        Go on from what was taken there.
    """

    def __init__(self, silhouette: Silhouette, bits: Mask, fronts: F64, *, after: Tally | None = None) -> None:
        pixels = silhouette.pixels
        self.seen = np.flatnonzero(pixels)  # directions in which there is something to cover
        self.bits = bits[:, self.seen].reshape(len(bits), len(self.seen), bits.shape[2] * bits.shape[3])
        facing = fronts @ silhouette.frames[self.seen, 2].T
        anyhow = np.asarray(~fronts.any(axis=1))[:, None]
        # [candidate, opposite?, direction]
        self.facing = np.stack([(facing > 0) | anyhow, (facing < 0) | anyhow], axis=1)
        self.weight = 1 / (2 * len(self.seen) * pixels[self.seen]) if len(self.seen) else np.zeros(0)
        self.left: Mask = np.ones((2, *self.bits.shape[1:]), bool) if after is None else after.left.copy()

    def gains(self, rows: NDArray[np.int64]) -> F64:
        """(k,) share of the silhouette that candidates would add, mean over directions."""
        out = np.zeros(len(rows))
        for i, row in enumerate(rows):
            for side in (0, 1):
                k = np.flatnonzero(self.facing[row, side])
                new = np.count_nonzero(self.bits[row, k] & self.left[side, k], axis=1)
                out[i] += float(new @ self.weight[k])
        return out

    def take(self, row: int) -> None:
        """Count a candidate as chosen."""
        for side in (0, 1):
            k = self.facing[row, side]
            self.left[side, k] &= ~self.bits[row, k]

    def choose(self, count: int, least: float, worth: F64) -> list[tuple[int, float]]:
        """Take candidates, always the one that adds most, until that is too little.

        Parameters
        ----------
        count : int
            How many at most.
        least : float
            What each has to add.
        worth : (c,) float
            Factors by which gains are multiplied when they are compared.

        Returns
        -------
        list of (candidate, gain)
        """
        rows = np.arange(len(self.bits))
        # what a candidate adds only gets less: an old gain is a bound, and most need no second look
        bound = self.gains(rows) * worth
        chosen: list[tuple[int, float]] = []
        while len(chosen) < count and len(rows):
            order = np.argsort(-bound, kind="stable")
            best, best_gain = -1, 0.0
            for row in order:
                if bound[row] <= best_gain:
                    break
                bound[row] = self.gains(np.array([row]))[0] * worth[row]
                if bound[row] > best_gain:
                    best, best_gain = int(row), float(bound[row])
            if best < 0 or best_gain / worth[best] < least:
                break
            chosen.append((best, best_gain / worth[best]))
            self.take(best)
            bound[best] = 0.0
        return chosen
