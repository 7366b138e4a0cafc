"""Where one can walk in a scene that nobody prepared: its ground, what stands on it, and a long free route.

The surfaces are sampled onto a horizontal grid. The ground is the largest connected piece of low, upward-facing,
nearly level surface; a cell of it is free if nothing reaches into the space of a walker above it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .paths import upright_axes
from .sampling import row_triangles, triangle_samples

if TYPE_CHECKING:
    from ..snapshot import Snapshot

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Cells along the longer side of the grid.
CELLS = 256
#: A person's eyes, in meters: assumed wherever a scene's size allows that its unit is the meter.
EYE_HEIGHT = 1.7
#: A surface is level if its normal is within about 25 degrees of up.
LEVEL = 0.9
#: The ground covers at least this share of the cells that hold anything.
SHARE = 0.25
#: Most of it rises by no more than this share of its size.
RELIEF = 0.1
#: A route keeps within this many eye heights of things, if it can: they are what a walker wants to see.
NEARBY = 15.0
#: A route shorter than this many eye heights is none.
SHORTEST = 6.0


@dataclass(frozen=True)
class Ground:
    """A walkable surface on a grid.

    Attributes
    ----------
    origin : (3,) float64
        World position of the outer corner of cell (0, 0), at height 0 of `height`.
    axes : (3, 3) float64
        Rows: directions of the first and the second index, and up.
    cell : float
        Edge of a cell in world units.
    height : (a, b) float64
        NaN where there is no ground.
    free : (a, b) bool
        Ground with room for a walker.
    remote : (a, b) float64
        Distance in world units from what is taller than a walker.
    eye_height : float
        In world units.
    """

    origin: Floats
    axes: Floats
    cell: float
    height: Floats
    free: Mask
    remote: Floats
    eye_height: float

    def route(self, *, longest: float = 250.0) -> Floats | None:
        """(k, 3) footsteps of a long walk that keeps clear of things; None if too little is free.

        Parameters
        ----------
        longest : float
            In eye heights; a longer route is cut to its middle.
        """
        from scipy import ndimage

        clearance = ndimage.distance_transform_edt(np.pad(self.free, 1))[1:-1, 1:-1]
        for reach, margin in itertools.product((NEARBY * self.eye_height, np.inf), (3.0, 2.0, 1.0)):
            labels, count = ndimage.label((clearance >= margin) & (self.remote <= reach), np.ones((3, 3)))
            sizes = np.bincount(labels.ravel(), minlength=2)[1:]
            if count and sizes.max() * self.cell >= 2 * SHORTEST * self.eye_height:
                break
        else:
            return None
        cells = np.argwhere(labels == 1 + int(np.argmax(sizes)))
        # where it is wide, and through the middle of things rather than around them
        off_center = ((cells - cells.mean(axis=0)) ** 2).sum(axis=1) / cells.var(axis=0).sum()
        toll = (1 + 4 / clearance[tuple(cells.T)]) * (1 + 2 * off_center)
        order = _longest_path(cells, toll)
        # half a margin of smoothing: the zigzag of the grid goes, the clearance stays
        steps = ndimage.gaussian_filter1d(cells[order] + 0.5, 1.0, axis=0, mode="nearest") * self.cell
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(steps, axis=0), axis=1))])
        if along[-1] < SHORTEST * self.eye_height:
            return None
        # the last steps lead to the edge of the scene, where there is nothing ahead
        spare = max(along[-1] - longest * self.eye_height, 0.2 * along[-1]) / 2
        keep = (along >= spare) & (along <= along[-1] - spare)
        rise = self.height[tuple(cells[order].T)]
        rise = ndimage.gaussian_filter1d(rise, 2.0, mode="nearest")
        local = np.column_stack([steps, rise])[keep]
        return np.asarray(self.origin + local @ self.axes)


def _longest_path(cells: NDArray[np.intp], toll: Floats) -> NDArray[np.intp]:
    """Indices into `cells` (k, 2) along the cheapest path between two that are far apart.

    Parameters
    ----------
    cells : (k, 2) int
        A connected piece of the grid.
    toll : (k,) float64
        Cost of a step in each cell.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    low = cells.min(axis=0) - 1
    index = np.full(np.ptp(cells, axis=0) + 3, -1)
    index[tuple((cells - low).T)] = np.arange(len(cells))
    starts, ends, steps = [], [], []
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = index[tuple((cells - low + step).T)]
        here = np.flatnonzero(other >= 0)
        starts.append(here)
        ends.append(other[here])
        steps.append(np.full(len(here), np.hypot(*step)))
    i, j, length = np.concatenate(starts), np.concatenate(ends), np.concatenate(steps)

    def sweep(costs: Floats, start: int) -> tuple[Floats, NDArray[np.int32]]:
        graph = coo_array((costs, (i, j)), shape=(len(cells), len(cells))).tocsr()
        distance, before = dijkstra(graph, directed=False, indices=np.array(start), return_predecessors=True)
        return np.where(np.isfinite(distance), distance, -1.0), before

    middle = int(np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1)))
    end = int(np.argmax(sweep(length, middle)[0]))
    start = int(np.argmax(sweep(length, end)[0]))
    _, before = sweep(length * (toll[i] + toll[j]) / 2, end)
    path = [start]
    while path[-1] != end:
        path.append(int(before[path[-1]]))
    return np.array(path)


def find_ground(snapshot: Snapshot, up: ArrayLike) -> Ground | None:
    """The ground of a scene, or None where nothing in it is one.

    Parameters
    ----------
    snapshot : Snapshot
    up : 3 floats

    Notes
    -----
    Drawables much smaller than a cell count as boxes, so a large scene of many small things stays quick.
    """
    from scipy import ndimage

    frame = upright_axes(up)
    known = np.flatnonzero(np.isfinite(snapshot.boxes).all(axis=0))
    if not len(known):
        return None
    centers = frame @ (snapshot.boxes[:3, known] - snapshot.origin[:, None])
    halves = np.abs(frame) @ snapshot.boxes[3:, known]
    low, high = (centers - halves).min(axis=1), (centers + halves).max(axis=1)
    span = float((high - low)[:2].max())
    if not ((high - low)[:2] > 0).all():
        return None
    cell = span / CELLS
    shape = tuple(int(np.ceil(s / cell)) for s in (high - low)[:2])
    origin = snapshot.origin + low @ frame
    small = (halves[:2].max(axis=0) < cell) & (halves[2] > 0.1 * halves[:2].max(axis=0))
    boxes, extent = (centers - low[:, None])[:, small], halves[:, small]
    points, upward = triangle_samples(row_triangles(snapshot, known[~small], frame, origin), 0.7 * cell)
    finite = np.isfinite(points).all(axis=1)
    points, upward = points[finite], upward[finite]
    # not from the boxes, which stand out where up is along no axis
    floor = min(points[:, 2].min(initial=np.inf), (boxes[2] - extent[2]).min(initial=np.inf))
    tall = float(max(points[:, 2].max(initial=-np.inf), (boxes[2] + extent[2]).max(initial=-np.inf)) - floor)
    if tall < 1e-3 * span:
        return None
    in_meters = tall > 2 * EYE_HEIGHT and span < 2e5
    eye = EYE_HEIGHT if in_meters else 0.1 * tall

    def cells_of(xy: Floats) -> NDArray[np.intp]:
        ij = np.clip((xy / cell).astype(int), 0, np.array(shape) - 1)
        return np.asarray(ij[..., 0] * shape[1] + ij[..., 1])

    where = cells_of(points[:, :2])
    height = np.full(shape[0] * shape[1], np.inf)
    level = upward > LEVEL
    np.minimum.at(height, where[level], points[level, 2])
    grid = height.reshape(shape)
    piece = _largest_level_piece(grid, max(0.45 * cell, min(0.25 * eye, 1.5 * cell)))
    occupied = np.zeros(height.shape, bool)
    occupied[where] = True
    occupied[cells_of(boxes[:2].T)] = True
    if piece is None or piece.sum() < SHARE * occupied.sum():
        return None
    bottom, middle, top = np.percentile(grid[piece], [10, 50, 90])
    if middle - floor > 0.4 * tall or top - bottom > RELIEF * cell * np.sqrt(piece.sum()):
        return None

    # what stands on the ground, judged by the ground nearest to each cell
    nearest = ndimage.distance_transform_edt(~piece, return_distances=False, return_indices=True)
    base = grid[tuple(nearest)].ravel()
    above = points[:, 2] - base[where]
    blocked = np.zeros(height.shape, bool)
    blocked[where[(above > 0.3 * eye) & (above < 1.4 * eye)]] = True
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            at = cells_of((boxes[:2] + extent[:2] * np.array([[dx], [dy]])).T)
            under, over = boxes[2] - extent[2] - base[at], boxes[2] + extent[2] - base[at]
            blocked[at[(over > 0.3 * eye) & (under < 1.4 * eye)]] = True
    tall_cells = np.zeros(height.shape, bool)
    tall_cells[where[above > eye]] = True
    at = cells_of(boxes[:2].T)
    tall_cells[at[boxes[2] + extent[2] - base[at] > eye]] = True
    if not tall_cells.any():
        return None
    things = tall_cells.reshape(shape)
    i, j = np.nonzero(things)
    among = np.zeros(shape, bool)
    among[max(i.min() - 4, 0) : i.max() + 5, max(j.min() - 4, 0) : j.max() + 5] = True
    free = piece & among & ~blocked.reshape(shape)
    if not in_meters:
        # a person may be indoors; in a thing that one holds in the hand, a floor with a ceiling is its hollow inside
        free &= ~things
    free &= ~_under_outer_faces(where, above, upward, 1.4 * eye, height.size).reshape(shape)
    remote = np.asarray(cell * ndimage.distance_transform_edt(~things))
    return Ground(origin, frame, cell, np.where(piece, grid, np.nan), free, remote, eye)


def _under_outer_faces(where: NDArray[np.intp], above: Floats, upward: Floats, over: float, size: int) -> Mask:
    """(size,) cells in which the first surface above a walker faces up: they lie inside something solid.

    A ceiling faces down. The top of a box or the back of a rabbit faces up, and below it is the inside of the model.
    """
    sample = np.flatnonzero((above >= over) & (np.abs(upward) > 0.1))
    sample = sample[np.lexsort([above[sample], where[sample]])]
    cell, first = np.unique(where[sample], return_index=True)
    found = np.zeros(size, bool)
    found[cell] = upward[sample[first]] > 0
    return found


def _largest_level_piece(grid: Floats, step: float) -> Mask | None:
    """(a, b) mask of the largest connected piece of finite cells whose neighbors differ by at most `step`."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    index = np.arange(grid.size).reshape(grid.shape)
    pairs = []
    for a, b in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        with np.errstate(invalid="ignore"):
            joined = np.abs(grid[a] - grid[b]) <= step
        pairs.append(np.stack([index[a][joined], index[b][joined]]))
    i, j = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(i), bool), (i, j)), shape=(grid.size, grid.size))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels, weights=np.isfinite(grid).ravel())
    if sizes.max() < 16:
        return None
    return np.asarray((labels == np.argmax(sizes)).reshape(grid.shape) & np.isfinite(grid))
