"""The occlusion map without a GPU: outlines of occluders, scan-converted in NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, View
from scenegraph.kernels.contours import face_turns, mesh_outline
from scenegraph.kernels.coverage import edge_spans
from scenegraph.kernels.nearness import (
    FARTHEST,
    NEAREST,
    NearnessScale,
    nearness_codes,
    nearness_of,
    plane_nearness,
    span_nearness,
)
from scenegraph.kernels.slices import slice_expand
from scenegraph.kernels.spans import span_maximum

from .shapes import F64, I64, ShapeTable

#: Rounding of the transforms in units of float64 epsilon times the coordinates' magnitude.
ROUNDING = 16.0

#: Rasterizers snap corners to 1/256 of a pixel: outlines are made thicker by that, lest a picture shows what we hid.
SNAPPING = 1.0 / 256.0

#: Along a piece of a span nearness changes by at most this part of its least value (in parallel views, of the range of
#: the map). Finer steps hide nothing more in street views, and cost (tests/bench/bench_hom.py).
DEPTH_STEP, PARALLEL_STEP = 1.0 / 8.0, 1.0 / 64.0


@dataclass(frozen=True)
class Drawn:
    """A map of nearness codes, and the pieces of spans that it was painted from.

    Attributes
    ----------
    codes : (height, width) uint16
        Code of the farthest point at which the texel is surely closed, the nearest shape deciding; 0 where it is not.
    instance, row, first, end : (k,) int64
        Texels [first, end) of a row are covered by an instance.
    piece_codes : (k,) uint16
    """

    codes: NDArray[np.uint16]
    instance: I64
    row: I64
    first: I64
    end: I64
    piece_codes: NDArray[np.uint16]

    def winning_rects(self, number: I64, count: int) -> I64:
        """(4, count) bounding rectangles of the texels that no other group of instances covers from nearer.

        Parameters
        ----------
        number : (m,) int64
            Group of each instance, from 0 to count - 1; -1 for instances that are not asked for.
        count : int
        """
        width = self.codes.shape[1]
        group = number[self.instance]
        asked = np.flatnonzero(group >= 0)
        begin = self.row[asked] * width
        texel = slice_expand(begin + self.first[asked], begin + self.end[asked])
        piece = np.repeat(asked, self.end[asked] - self.first[asked])
        wins = self.codes.reshape(-1)[texel] == self.piece_codes[piece]
        texel, group = texel[wins], group[piece[wins]]
        y, x = np.divmod(texel, width)
        rects = np.zeros((4, count), np.int64)
        rects[:2] = np.iinfo(np.int64).max
        for i, (combine, value) in enumerate(
            ((np.minimum, x), (np.minimum, y), (np.maximum, x + 1), (np.maximum, y + 1))
        ):
            combine.at(rects[i], group, value)
        return rects


def scan_map(
    view: View,
    table: ShapeTable,
    shapes: I64,
    matrices: F64,
    hollow: NDArray[np.bool_],
    /,
    *,
    size: tuple[int, int],
    scale: NearnessScale,
    strict: bool,
) -> Drawn:
    """Draw shapes into a map of nearness codes.

    Parameters
    ----------
    view : View
    table : ShapeTable
    shapes : (m,) int64
        Which shape each instance is.
    matrices : (m, 4, 4) float64
        Its local-to-world matrix.
    hollow : (m,) bool
        With the eye inside, its walls hide what is beyond them; otherwise it does not occlude then.
    size : width, height of the map
    scale : NearnessScale
    strict : bool
        Texels that one shape covers wholly; otherwise those whose center it covers.
    """
    if not len(shapes):
        none = np.zeros(0, np.int64)
        return Drawn(np.zeros(size[::-1], np.uint16), none, none, none, none, np.zeros(0, np.uint16))
    # what overflows or is not a number ends up in no outline
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _scan(view, table, shapes, matrices, hollow, size, scale, strict=strict)


def _scan(
    view: View,
    table: ShapeTable,
    shapes: I64,
    matrices: F64,
    hollow: NDArray[np.bool_],
    size: tuple[int, int],
    scale: NearnessScale,
    *,
    strict: bool,
) -> Drawn:
    points, error, vertex_shift, of_vertex = _eye_space(view, table, shapes, matrices)
    count = np.diff(table.face_first)[shapes]
    chosen = slice_expand(table.face_first[shapes], table.face_first[shapes + 1])
    instance = np.repeat(np.arange(len(shapes)), count)
    faces = table.faces[chosen] + np.repeat(vertex_shift, count)[:, None]
    edge_count = np.diff(table.edge_first)[shapes]
    edge_shift = np.cumsum(edge_count) - edge_count - table.edge_first[shapes]
    face_edges = table.face_edges[chosen] + np.repeat(edge_shift, count)[:, None]
    edges = table.edges[slice_expand(table.edge_first[shapes], table.edge_first[shapes + 1])]
    edges = edges + np.repeat(vertex_shift, edge_count)[:, None]

    facets, turn, outer = _facet_turns(view, table, shapes, matrices, points, vertex_shift)
    facet_count = np.diff(table.facet_first)[shapes]
    facet_shift = np.cumsum(facet_count) - facet_count - table.facet_first[shapes]
    of_facet = table.facet[chosen] + np.repeat(facet_shift, count)
    depth = -points[2]
    face_depth = depth[faces].max(axis=1)
    # where no outer side is before the eye, the eye is inside
    before = (outer[of_facet] != 0) & (face_depth >= view.near)
    from_outside = np.bincount(instance, before, minlength=len(shapes)) > 0
    turn = np.where(np.repeat(from_outside | ~hollow, facet_count), outer, turn)
    face_turn = turn[of_facet]
    start, end, weight, cuts = mesh_outline(
        depth, edges, faces, face_edges, table.face_signs[chosen], face_turn * table.layer[chosen], near=view.near
    )
    planes = _planes(view, table.has_planes[shapes] & from_outside, facets, turn, facet_count, size)
    counted = face_turn != 0
    _level_depths(view, planes, instance[counted], face_depth[counted])
    points, error = _with_cuts(view, points, error, edges[cuts])
    x, y, slack = on_map(view, size, points, error)
    slack += snapping(view, size)
    group = np.concatenate([of_vertex, of_vertex[edges[cuts, 0]]])[start]
    thick = np.maximum(slack[start], slack[end]) if strict else 0.0
    spans = edge_spans(
        np.stack([x[start], y[start], x[end], y[end]]), weight, group, size=size, slack=thick, strict=strict
    )
    step = PARALLEL_STEP * (NEAREST - FARTHEST) / scale.factor if view.is_parallel else DEPTH_STEP
    span, first, stop, nearness = span_nearness(*spans, planes, step=step, relative=not view.is_parallel)
    codes = nearness_codes(nearness, scale)
    instance, row = spans[0].take(span), spans[1].take(span)
    return Drawn(span_maximum(row, first, stop, codes, size=size), instance, row, first, stop, codes)


def _eye_space(view: View, table: ShapeTable, shapes: I64, matrices: F64) -> tuple[F64, F64, I64, I64]:
    """(3, v) points and (v,) bound of their error; what each instance adds to vertex indices; instances of points."""
    count = np.diff(table.vertex_first)[shapes]
    chosen = slice_expand(table.vertex_first[shapes], table.vertex_first[shapes + 1])
    instance = np.repeat(np.arange(len(shapes)), count)
    eye = np.asarray(view.eye)
    linear = view.axes @ matrices[:, :3, :3]
    origin = matrices[:, :3, 3]
    shift = (origin - eye) @ view.axes.T
    local = table.vertices[chosen]
    points = np.einsum("nij,nj->in", linear[instance], local) + shift[instance].T
    size = np.abs(points).sum(axis=0) + 2 * (np.abs(origin).sum(axis=1)[instance] + np.abs(eye).sum())
    vertex_shift = np.cumsum(count) - count - table.vertex_first[shapes]
    return points, ROUNDING * np.finfo(np.float64).eps * size, vertex_shift, instance


def _facet_turns(
    view: View, table: ShapeTable, shapes: I64, matrices: F64, points: F64, vertex_shift: I64
) -> tuple[tuple[F64, F64], NDArray[np.int8], NDArray[np.int8]]:
    """Normal and offset of every facet; how it turns; and the same with 0 where its inner side is turned to the eye."""
    count = np.diff(table.facet_first)[shapes]
    chosen = slice_expand(table.facet_first[shapes], table.facet_first[shapes + 1])
    corners = table.faces[table.facet_face[chosen]] + np.repeat(vertex_shift, count)[:, None]
    turn, normal, offset = face_turns(points, corners, parallel=view.is_parallel)
    # a mirror turns every loop around
    mirrored = np.where(np.linalg.det(matrices[:, :3, :3]) < 0, -1, 1).astype(np.int8)
    outward = table.outward[chosen] * np.repeat(mirrored, count)
    return (normal, offset), turn, np.where(outward * turn < 0, np.int8(0), turn)


def _planes(
    view: View,
    has_planes: NDArray[np.bool_],
    facets: tuple[F64, F64],
    turn: NDArray[np.int8],
    facet_count: I64,
    size: tuple[int, int],
) -> F64:
    """(p, 3, m) nearness of the facets that count, for instances with planes; the rest is left infinitely near."""
    index = np.flatnonzero(np.repeat(has_planes, facet_count) & (turn != 0))
    instance = np.repeat(np.arange(len(has_planes)), facet_count)[index]
    rank = np.arange(len(index)) - np.searchsorted(instance, instance)
    planes = np.zeros((int(rank.max(initial=0)) + 1, 3, len(has_planes)))
    planes[:, 2] = np.inf
    normal, offset = facets
    planes[rank, :, instance] = plane_nearness(
        normal[:, index], offset[index], window=view.window, size=size, parallel=view.is_parallel
    ).T
    return planes


def _level_depths(view: View, planes: F64, instance: I64, face_depth: F64) -> None:
    """Put the depth of the farthest corner of the faces that count where an instance has no planes."""
    farthest = np.full(planes.shape[2], -np.inf)
    np.maximum.at(farthest, instance, face_depth)
    level = ~np.isfinite(planes[0, 2])
    if view.is_parallel:
        nearness = np.where(np.isfinite(farthest), -farthest, -np.inf)
    else:
        # nothing that counts, or nothing in front of the eye: infinitely far, and never drawn
        nearness = np.where(farthest > 0, nearness_of(farthest, parallel=False), 0.0)
    planes[0, 2, level] = nearness[level]


def _with_cuts(view: View, points: F64, error: F64, cut: I64) -> tuple[F64, F64]:
    """The points, and behind them those where edges cut the near plane."""
    if not len(cut):
        return points, error
    a, b = points[:, cut[:, 0]], points[:, cut[:, 1]]
    met = a + (b - a) * ((-view.near - a[2]) / (b[2] - a[2]))
    met[2] = -view.near
    return np.concatenate([points, met], axis=1), np.concatenate(
        [error, np.maximum(error[cut[:, 0]], error[cut[:, 1]])]
    )


def on_map(view: View, size: tuple[int, int], points: F64, error: F64) -> tuple[F64, F64, F64]:
    """Map coordinates x and y of points in eye space, and their uncertainty in texels.

    Points before the near plane come out somewhere.
    """
    left, right, bottom, top = view.window
    scale = size[0] / (right - left), size[1] / (top - bottom)
    if view.is_parallel:
        u, v, spread = points[0], points[1], error
    else:
        ahead = np.maximum(-points[2], view.near)
        u, v = points[0] / ahead, points[1] / ahead
        spread = error * (1.0 + np.abs(u) + np.abs(v)) / ahead
    return (u - left) * scale[0], (v - bottom) * scale[1], spread * max(scale)


def snapping(view: View, size: tuple[int, int]) -> float:
    """What a rasterizer that draws the view may move a corner by, in texels of the map."""
    return SNAPPING * max(size[0] / view.width, size[1] / view.height)


def texels_per_unit(frame: Frame, packed: NDArray[np.float32], matrices: F64, size: tuple[int, int]) -> F64:
    """Upper bound of the texels that a unit of local length can cover, for things in boxes under matrices.

    Parameters
    ----------
    frame : Frame
    packed : (m, 8) float32
        Their boxes, as `Snapshot.packed`.
    matrices : (m, 4, 4) float64
    size : width, height of the map
    """
    view = frame.view
    boxes = packed.astype(np.float64)
    left, right, bottom, top = view.window
    scale: F64 | float = max(size[0] / (right - left), size[1] / (top - bottom))
    if not view.is_parallel:
        center = boxes[:, :3] @ view.forward - view.forward @ view.relative_eye(frame.snapshot.origin)
        depth = np.maximum(center - boxes[:, 3:6] @ np.abs(view.forward), view.near)
        # away from the axis images are stretched
        scale = scale * (1.0 + left * left + right * right + bottom * bottom + top * top) / depth
    linear = np.abs(matrices[:, :3, :3])
    # the largest singular value is at most the geometric mean of the largest row and column sums
    return np.asarray(scale * np.sqrt(linear.sum(axis=1).max(axis=1) * linear.sum(axis=2).max(axis=1)))
