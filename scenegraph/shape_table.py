"""ShapeTable: the meshes of a snapshot, and the combinations of levels that its drawables share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .kernels.boxes import box_from_bounds
from .mesh import Mesh
from .nodes import Geode, Lod


@dataclass(frozen=True)
class ShapeTable:
    """A shape is what drawables share: the meshes of all levels and their model errors.

    Attributes
    ----------
    meshes : list of Mesh
    levels : (s, L) int32
        Index into `meshes` per level, -1 where a shape has fewer levels.
    errors : (s, L) float64
        Model error of each level in local units; NaN where unknown.
    boxes : (6, s) float64
        Boxes around all levels in local coordinates: center, half extent.
    """

    meshes: list[Mesh]
    levels: NDArray[np.int32]
    errors: NDArray[np.float64]
    boxes: NDArray[np.float64]

    @classmethod
    def build(
        cls,
        drawables: Sequence[Geode | Lod],
        chains: Mapping[Mesh, Sequence[tuple[Mesh, float]]],
        known: Sequence[Mesh] = (),
    ) -> tuple[ShapeTable, NDArray[np.int32]]:
        """Number meshes and shapes.

        Parameters
        ----------
        drawables : (n,) sequence of Geode or Lod
        chains : mapping of Mesh to sequences of (Mesh, float)
            Levels for the meshes of geodes, see `Snapshot.adopt_levels`.
        known : sequence of Mesh
            They keep their numbers.

        Returns
        -------
        table : ShapeTable
        index : (n,) int32
            Which shape each drawable has.
        """
        all_meshes = list(known)
        mesh_number = {id(mesh): number for number, mesh in enumerate(all_meshes)}
        shape_number: dict[tuple[object, ...], int] = {}
        key: tuple[object, ...]
        shapes: list[tuple[tuple[int, ...], tuple[float, ...]]] = []
        index = np.empty(len(drawables), np.int32)
        for row, node in enumerate(drawables):
            if isinstance(node, Geode):
                chain = chains.get(node._mesh)
                levels = (node._mesh,) if chain is None else tuple(mesh for mesh, _ in chain)
                errors = (0.0,) if chain is None else tuple(error for _, error in chain)
                key = (id(node._mesh),)
            else:
                levels, errors = tuple(g._mesh for g in node.levels), node.errors
                key = (*map(id, levels), *map(str, errors))
            number = shape_number.get(key)
            if number is None:
                for mesh in levels:
                    if id(mesh) not in mesh_number:
                        mesh_number[id(mesh)] = len(all_meshes)
                        all_meshes.append(mesh)
                number = shape_number[key] = len(shapes)
                shapes.append((tuple(mesh_number[id(m)] for m in levels), errors))
            index[row] = number
        depth = max((len(s[0]) for s in shapes), default=1)
        shape_levels = np.full((len(shapes), depth), -1, np.int32)
        shape_errors = np.full((len(shapes), depth), np.nan)
        bounds = np.full((6, len(shapes)), np.nan)
        for i, (meshes, errors) in enumerate(shapes):
            shape_levels[i, : len(meshes)] = meshes
            shape_errors[i, : len(errors)] = errors
            corners = np.array([all_meshes[m].bounds for m in meshes])
            bounds[:3, i], bounds[3:, i] = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        return cls(all_meshes, shape_levels, shape_errors, box_from_bounds(bounds[:3], bounds[3:])), index

    def triangles(self, level_meshes: NDArray[np.int32]) -> NDArray[np.int32]:
        """(L, n) triangles of each level of rows whose meshes are (n, L); 0 where there is no such level."""
        counts = np.array([m.triangles for m in self.meshes] + [0], np.int32)
        return np.ascontiguousarray(counts[level_meshes].T)

    def world_errors(
        self, shapes: NDArray[np.int32], transforms: NDArray[np.float64], transform_index: NDArray[np.int32]
    ) -> NDArray[np.float64]:
        """Model errors in world units: times the largest singular value, by which a matrix can stretch them at most.

        Parameters
        ----------
        shapes, transform_index : (m,) int32
            Of each row.
        transforms : (t, 4, 4) float64

        Returns
        -------
        (L, m) float64
            NaN where a matrix is not finite.
        """
        errors = self.errors[shapes].T
        if len(errors) > 1:
            used, which = np.unique(transform_index, return_inverse=True)
            linear = transforms[used, :3, :3]
            gram = np.einsum("tij,tik->tjk", linear, linear)
            stretch = np.full(len(gram), np.nan)
            finite = np.isfinite(gram).all(axis=(1, 2))
            stretch[finite] = np.sqrt(np.maximum(np.linalg.eigvalsh(gram[finite])[:, -1], 0.0))
            errors = errors * stretch[which]
        return errors
