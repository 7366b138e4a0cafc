"""What the viewer can show of the stage: which occluder hid what, and the shadows themselves."""

from __future__ import annotations

import colorsys
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scenegraph import Faces, Frame, Lines, OccluderTable, Overlay

from .frusta import ShadowFrusta

Color = tuple[float, float, float]

VISIBLE: Color = (0.88, 0.88, 0.86)
ELSEWHERE: Color = (0.62, 0.62, 0.64)

#: Shadows are drawn up to this depth, as a share of the far plane's.
REACH = 0.05


def occluder_color(rank: int) -> Color:
    """A hue for each rank; neighbors in rank are far apart on the color circle."""
    return colorsys.hsv_to_rgb((0.61 + rank * 0.381966) % 1.0, 0.62 if rank % 2 else 0.78, 0.86)


class ByOccluder(Overlay):
    """What the shadow stage hid, in the color of the best-ranked occluder that hides it."""

    name = "by occluder"
    stage = "shadow"

    def colors(self, frame: Frame) -> NDArray[np.float64] | None:
        """One color per occluder, light gray for what is visible, darker for what other stages hid."""
        frusta = frame.find(ShadowFrusta)
        if frusta is None:
            return None
        stage = [record.name for record in frame.record.stages].index(self.stage)
        table = np.array([*map(occluder_color, range(len(frusta))), ELSEWHERE, VISIBLE])
        number = np.where(frame.visible, len(frusta) + 1, len(frusta))
        rows = np.flatnonzero(frame.hidden_by() == stage)
        number[rows] = hidden_by_occluder(frusta, frame, rows)
        return np.column_stack([table[number], np.ones(len(number))])

    def legend(self, frame: Frame) -> list[tuple[str, Color]]:
        """The first occluders by rank, and how many drawables each hides."""
        frusta = frame.find(ShadowFrusta)
        if frusta is None:
            return []
        stage = [record.name for record in frame.record.stages].index(self.stage)
        rows = np.flatnonzero(frame.hidden_by() == stage)
        count = np.bincount(hidden_by_occluder(frusta, frame, rows), minlength=len(frusta))
        table = frame.snapshot.occluders
        shown = [
            (f"{label(table, i)}: {count[rank]:,}", occluder_color(rank))
            for rank, i in enumerate(frusta.ids[:8].tolist())
        ]
        return [("visible", VISIBLE), *shown, ("hidden by other stages", ELSEWHERE)]


class Shadows(Overlay):
    """The active occluders, their silhouettes and the beginning of their shadows."""

    name = "shadow frusta"
    stage = "shadow"

    def lines(self, frame: Frame) -> list[Lines]:
        """Silhouettes, and rays from their points away from the eye."""
        frusta = frame.find(ShadowFrusta)
        out: list[Lines] = []
        if frusta is None:
            return out
        table, view = frame.snapshot.occluders, frame.view
        for rank, number in enumerate(frusta.ids.tolist()):
            edges = table.vertices[silhouette(table, number, frusta.eye, view.forward if view.is_parallel else None)]
            points = np.unique(edges.reshape(-1, 3), axis=0)
            rays = np.stack([points, shadow_ends(points, frame)], axis=1)
            color = occluder_color(rank)
            out += [Lines(edges, color, 2.5), Lines(rays, color, 1.0)]
        return out

    def faces(self, frame: Frame) -> list[Faces]:
        """The occluders, and the sides of their shadows."""
        frusta = frame.find(ShadowFrusta)
        out: list[Faces] = []
        if frusta is None:
            return out
        table, view = frame.snapshot.occluders, frame.view
        for rank, number in enumerate(frusta.ids.tolist()):
            edges = table.vertices[silhouette(table, number, frusta.eye, view.forward if view.is_parallel else None)]
            sides = np.concatenate([edges, shadow_ends(edges.reshape(-1, 3), frame).reshape(edges.shape)], axis=1)
            corners = np.array([(0, 1, 3), (0, 3, 2)]) + 4 * np.arange(len(sides))[:, None, None]
            out.append(Faces(sides.reshape(-1, 3), corners.reshape(-1, 3), occluder_color(rank), 0.07))
            base = int(table.vertex_first[number])
            triangles = [
                (loop[0], a, b)
                for face in range(table.face_first[number], table.face_first[number + 1])
                for loop in [table.loop[table.loop_first[face] : table.loop_first[face + 1]] - base]
                for a, b in pairwise(loop[1:])
            ]
            out.append(Faces(table.points_of(number), np.array(triangles), occluder_color(rank), 0.35))
        return out


def label(table: OccluderTable, number: int) -> str:
    """What users call an occluder: its name, or that of the group it stands in."""
    node = table.nodes[number]
    return node.name or (node.parent.name if node.parent is not None else "") or f"occluder {number}"


def shadow_ends(points: NDArray[np.float64], frame: Frame) -> NDArray[np.float64]:
    """(k, 3) where the drawing of the shadows of points (k, 3) ends."""
    view = frame.view
    way = np.broadcast_to(view.forward, points.shape) if view.is_parallel else points - view.eye
    return np.asarray(points + REACH * view.far * way / np.linalg.norm(way, axis=1)[:, None])


def hidden_by_occluder(frusta: ShadowFrusta, frame: Frame, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(k,) rank of the first occluder that hides each of some rows (k,) that the stage has hidden."""
    first, end = frusta.owner.T[..., None]
    hides = frusta.hides(frame.snapshot.boxes[:, rows]) & ~((rows >= first) & (rows < end))
    return hides.argmax(axis=0) if len(frusta) else np.zeros(len(rows), np.int64)


def silhouette(
    table: OccluderTable, number: int, eye: NDArray[np.float64], direction: NDArray[np.float64] | None
) -> NDArray[np.int64]:
    """(k, 2) vertices of the silhouette edges of one occluder."""
    faces = slice(int(table.face_first[number]), int(table.face_first[number + 1]))
    edges = slice(int(table.edge_first[number]), int(table.edge_first[number + 1]))
    corner = table.vertices[table.loop[table.loop_first[:-1][faces]]]
    toward = np.broadcast_to(direction, corner.shape) if direction is not None else corner - eye
    # one more for the side of a polygon's edge where there is no face
    front = np.append((table.normals[faces] * toward).sum(axis=1) < 0, False)
    if not table.solid[number]:
        front[0] = True
    sides = table.edge_faces[edges]
    beside = front[np.where(sides < 0, len(front) - 1, sides - faces.start)]
    return np.asarray(table.edges[edges][beside[:, 0] != beside[:, 1]])
