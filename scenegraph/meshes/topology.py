"""Shells of a triangle mesh: connected pieces, turned the same way, with the edges where they are open.

Only numpy and scipy; arrays in, arrays out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


@dataclass(frozen=True)
class Shell:
    """Triangles that hang together by edges.

    Attributes
    ----------
    triangles : (m, 3, 3) float64
        Corners, turned so that neighbors agree where that is possible.
    openings : tuple of (k, 2, 3) float64
        The directed edges at which the shell is open, one array per connected opening: those whose two directions do
        not cancel, repeated as often as they are left over. They close to loops: they are the boundary of a surface.
        Empty for a closed shell.
    chosen : (m,) int
        The rows of the input that the triangles come from.
    """

    triangles: F64
    openings: tuple[F64, ...]
    chosen: I64

    @property
    def is_closed(self) -> bool:
        """Whether every edge is passed as often in one direction as in the other."""
        return not self.openings

    @property
    def covers(self) -> F64:
        """(k, 3, 3) triangles over the openings: from the middle of each to its edges, turned to close the shell."""
        if not self.openings:
            return np.zeros((0, 3, 3))
        parts = []
        for edges in self.openings:
            middle = np.broadcast_to(edges.mean(axis=(0, 1)), (len(edges), 3))
            parts.append(np.stack([middle, edges[:, 1], edges[:, 0]], axis=1))
        return np.concatenate(parts)

    @property
    def area(self) -> float:
        """Of the triangles, without the covers."""
        return float(triangle_areas(self.triangles).sum())

    @property
    def volume(self) -> float:
        """Signed volume within triangles and covers; negative if the triangles face inward."""
        closed = np.concatenate([self.triangles, self.covers])
        p = closed - closed.mean(axis=(0, 1))
        return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6)


def triangle_areas(triangles: F64) -> F64:
    """(m,) areas of (m, 3, 3) triangles."""
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.asarray(0.5 * np.linalg.norm(np.cross(u, v), axis=1))


def weld(vertices: F64, faces: NDArray[np.integer]) -> tuple[F64, I64, I64]:
    """Merge vertices of exactly equal coordinates; drop faces that have become edges, and repeated faces.

    Nothing is merged by a tolerance: a gap of one bit is a gap.

    Parameters
    ----------
    vertices : (v, 3) float64
    faces : (f, 3) int

    Returns
    -------
    points : (p, 3) float64
    faces : (g, 3) int
        Into `points`.
    times : (g,) int
        How often each face counts in the shells. 0 for one that is there as often in one direction as in the other: a
        sheet without thickness, which encloses nothing; but 1 where most faces come in such pairs, as the mesh was made
        to be seen from both sides. 1 for repeated ones, unless counting them makes the mesh less open.
    """
    used, flat = np.unique(faces, return_inverse=True)
    p = vertices[used] + 0.0  # -0.0 and 0.0 are the same place
    order = np.lexsort(p.T)
    new = np.ones(len(p), bool)
    new[1:] = (p[order][1:] != p[order][:-1]).any(axis=1)
    number = np.empty(len(p), np.int64)
    number[order] = np.cumsum(new) - 1
    welded = number[flat.reshape(-1)].reshape(-1, 3)
    welded = welded[(welded != np.roll(welded, 1, axis=1)).all(axis=1)]
    ordered = np.sort(welded, axis=1)
    base = len(p)
    if base < 2_000_000:  # else three indices do not fit into 64 bits
        codes = (ordered[:, 0] * base + ordered[:, 1]) * base + ordered[:, 2]
        _, first, same = np.unique(codes, return_index=True, return_inverse=True)
    else:
        _, first, same = np.unique(ordered, axis=0, return_index=True, return_inverse=True)
    # an odd permutation of the ordered corners is the other direction
    forward = (welded[:, 0] < welded[:, 1]).astype(int) + (welded[:, 1] < welded[:, 2]) + (
        welded[:, 2] < welded[:, 0]
    ) == 2
    net = np.bincount(same.reshape(-1), np.where(forward, 1, -1), minlength=len(first)).astype(np.int64)
    backward = (net != 0) & ((net > 0) != forward[first])
    kept = np.where(backward[:, None], welded[first][:, ::-1], welded[first])
    as_given = np.argsort(first, kind="stable")
    kept, times = kept[as_given], np.abs(net)[as_given]
    if 2 * (times == 0).sum() > len(times):
        times[:] = 1
    elif times.max(initial=1) > 1 and open_edges(kept, times) >= open_edges(kept, np.minimum(times, 1)):
        times = np.minimum(times, 1)
    return p[order][new], kept, times


@dataclass(frozen=True)
class _Edges:
    """Half edges of faces: half edge `h` belongs to face `h % f` and runs along edge `of[h]`, forward or backward."""

    of: I64
    forward: NDArray[np.bool_]
    count: I64
    ends: I64


def _edges(faces: I64) -> _Edges:
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    low, high = half.min(axis=1), half.max(axis=1)
    base = int(faces.max(initial=0)) + 1
    codes, of, count = np.unique(low * base + high, return_inverse=True, return_counts=True)
    ends = np.stack([codes // base, codes % base], axis=1)
    return _Edges(of.reshape(-1).astype(np.int64), half[:, 0] < half[:, 1], count.astype(np.int64), ends)


def open_edges(faces: I64, times: I64) -> int:
    """How many edges are not passed as often in one direction as in the other, if faces count so many times."""
    edges = _edges(faces)
    return int(np.count_nonzero(np.bincount(edges.of, np.where(edges.forward, 1, -1) * np.tile(times, 3))))


def _labels(count: int, a: I64, b: I64) -> I64:
    # not at the top: with it, answering `scenegraph stages` takes half as long again
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(a), bool), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _joined(edges: _Edges, faces: int) -> tuple[I64, I64, NDArray[np.bool_]]:
    """Pairs of half edges on the same edge: the faces they belong to, and whether the two run the same way."""
    order = np.argsort(edges.of, kind="stable")
    same = edges.of[order][1:] == edges.of[order][:-1]
    a, b = order[:-1][same], order[1:][same]
    return a % faces, b % faces, edges.forward[a] == edges.forward[b]


def _turned(faces: I64) -> I64:
    """Faces of one piece turned to agree with their neighbors, if no edge has more than two faces.

    Each face is doubled, one copy for each way it can be turned; copies are linked when they agree. If the piece can be
    turned consistently, the copies fall into two halves that mirror each other.
    """
    edges, n = _edges(faces), len(faces)
    left, right, clash = _joined(edges, n)
    if not clash.any() or edges.count.max() > 2:
        return faces
    a = np.concatenate([left, left + n])
    b = np.concatenate([np.where(clash, right + n, right), np.where(clash, right, right + n)])
    half = _labels(2 * n, a, b)
    if half[0] == half[n]:
        return faces  # like a Möbius strip
    flip = half[:n] != half[0]
    if 2 * flip.sum() > n:
        flip = ~flip
    return np.where(flip[:, None], faces[:, ::-1], faces)


def _core(faces: I64) -> NDArray[np.bool_]:
    """What is left when faces with a free edge are taken away, again and again: sails on a hull, not the hull."""
    edges, n = _edges(faces), len(faces)
    left = np.ones(n, bool)
    count = edges.count.copy()
    order = np.argsort(edges.of, kind="stable")
    start = np.searchsorted(edges.of[order], np.arange(len(count) + 1))
    free = np.flatnonzero(count == 1)
    while len(free):
        # each free edge has one face left: the one that is still there among those around it
        span = start[free + 1] - start[free]
        around = (
            order[np.repeat(start[free], span) + np.arange(span.sum()) - np.repeat(np.cumsum(span) - span, span)] % n
        )
        gone = np.unique(around[left[around]])
        left[gone] = False
        touched = edges.of[np.concatenate([gone, gone + n, gone + 2 * n])]
        np.subtract.at(count, touched, 1)
        free = np.unique(touched[count[touched] == 1])
    return left


def shells(points: F64, faces: I64, *, limit: int = 64) -> tuple[list[Shell], int]:
    """Take a mesh apart into shells.

    A piece that is open loses what hangs on it by one side only; if a closed rest remains, that is a shell, too, and
    the only one if it is most of the piece.

    Parameters
    ----------
    points : (p, 3) float64
    faces : (f, 3) int
        Welded, see `weld`; repeated as often as they count.
    limit : int
        How many pieces are looked at, those of the largest area first.

    Returns
    -------
    shells : list of Shell
        Of at least four triangles each, as fewer enclose nothing; by area.
    pieces : int
        How many pieces there are in all.
    """
    if not len(faces):
        return [], 0
    edges = _edges(faces)
    left, right, _ = _joined(edges, len(faces))
    labels = _labels(len(faces), left, right)
    sizes = np.bincount(labels)
    areas = np.bincount(labels, triangle_areas(points[faces]))
    wanted = np.argsort(-areas, kind="stable")
    wanted = wanted[sizes[wanted] >= 4][:limit]
    order = np.argsort(labels, kind="stable")
    start = np.concatenate([[0], np.cumsum(sizes)])
    found: list[Shell] = []
    for piece in wanted:
        rows = order[start[piece] : start[piece + 1]]
        shell = _shell(points, faces, rows)
        if not shell.is_closed:
            inner = rows[_core(faces[rows])]
            if len(inner) >= 4:
                parts = _split(faces[inner])
                closed = [part for part in (_shell(points, faces, inner[p]) for p in parts) if part.is_closed]
                found.extend(closed)
                if sum(part.area for part in closed) > 0.5 * shell.area:
                    continue
        found.append(shell)
    return sorted(found, key=lambda s: -s.area), len(sizes)


def _split(faces: I64) -> list[I64]:
    left, right, _ = _joined(_edges(faces), len(faces))
    labels = _labels(len(faces), left, right)
    return np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1])


def _shell(points: F64, faces: I64, rows: I64) -> Shell:
    turned = _turned(faces[rows])
    edges = _edges(turned)
    net = np.bincount(edges.of, np.where(edges.forward, 1, -1), minlength=len(edges.ends)).astype(np.int64)
    # an edge passed forward twice and never back is open twice
    ids = np.repeat(np.arange(len(net)), np.abs(net))
    ends = np.where((net[ids] > 0)[:, None], edges.ends[ids], edges.ends[ids][:, ::-1])
    used, compact = np.unique(ends, return_inverse=True)
    compact = compact.reshape(-1, 2)
    around = _labels(len(used), compact[:, 0], compact[:, 1])[compact[:, 0]]
    openings = tuple(points[ends[around == k]] for k in range(around.max(initial=-1) + 1))
    return Shell(points[turned], openings, rows)


def scaled(shell: Shell, center: F64, size: float, axes: F64) -> Shell:
    """The shell in a frame of its own: `axes` (3, 3) are the rows of a rotation, `size` becomes 1."""

    def placed(p: F64) -> F64:
        return np.asarray(((p - center) / size) @ axes.T)

    return replace(shell, triangles=placed(shell.triangles), openings=tuple(placed(o) for o in shell.openings))
