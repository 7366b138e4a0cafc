"""Finer levels of a mesh: in one piece, with what the mesh had, and as round as its normals say."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh

from level_shapes import ball, brute_distance, random_points, sheet, unwelded
from scenegraph import Lod, Mesh, SceneError
from scenegraph.meshes import tessellate, tessellated_triangles, tessellation_chain


def welded(mesh: Mesh) -> trimesh.Trimesh:
    """Joined where positions are equal bit for bit, and nowhere else."""
    points, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    return trimesh.Trimesh(points, number.reshape(-1)[mesh.faces], process=False)


def crossed() -> Mesh:
    """Two balls that share a vertex, with a fin of three faces on one edge: not a manifold."""
    a = ball(2)
    b = a.vertices + 2 * a.vertices[0]
    fin = [[int(a.faces[0, 0]), int(a.faces[0, 1]), len(a.vertices) * 2]]
    points = np.concatenate([a.vertices, b, [[0.0, 0.0, 3.0]]])
    return Mesh(points, np.concatenate([a.faces, a.faces + len(a.vertices), fin]))


@pytest.mark.parametrize("level", [2, 3, 4, 7, 8])
class TestInOnePiece:
    def test_smooth(self, level):
        mesh = ball(3, 0.2, smooth=True)
        fine = tessellate(mesh, level)
        assert fine.triangles == tessellated_triangles(mesh, level)
        assert welded(fine).is_watertight
        assert welded(fine).is_winding_consistent

    def test_creased(self, level):
        mesh = unwelded(ball(3, 0.2))
        fine = tessellate(mesh, level)
        assert welded(fine).is_watertight
        assert len(welded(fine).vertices) == 2 + fine.triangles // 2

    def test_scanned_far_from_the_origin(self, level):
        plain = unwelded(ball(3, 0.2))
        mesh = Mesh(plain.vertices * 1e3 + 1e7, plain.faces, normals=plain.normals)
        assert welded(tessellate(mesh, level)).is_watertight

    def test_not_a_manifold(self, level):
        mesh = crossed()
        fine = tessellate(mesh, level)
        assert fine.triangles == tessellated_triangles(mesh, level)
        rim = np.sort(fine.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        _, uses = np.unique(rim, axis=0, return_counts=True)
        assert (uses == 1).sum() == 2 * level, "only the free sides of the fin are open"


class TestSurface:
    def test_level_one_is_the_mesh_itself(self):
        mesh = ball(2)
        assert tessellate(mesh, 1) is mesh

    def test_flat_stays_flat(self):
        assert np.abs(tessellate(sheet(3), 5).vertices[:, 2]).max() == 0

    def test_shape_zero_keeps_the_surface(self, rng):
        mesh = ball(2, smooth=True)
        fine = tessellate(mesh, 6, shape=0.0)
        assert brute_distance(fine.vertices, mesh).max() < 1e-7

    def test_a_ball_becomes_rounder(self):
        mesh = ball(2, smooth=True)
        fine = tessellate(mesh, 8)
        radius = np.linalg.norm(fine.vertices, axis=1)
        flat = np.linalg.norm(tessellate(mesh, 8, shape=0.0).vertices, axis=1)
        assert radius.min() > 0.5 + 0.5 * flat.min()
        around = fine.vertices / radius[:, None]
        assert (fine.normals * around).sum(axis=1).min() > 0.97

    def test_normals_that_cancel_leave_their_position_flat(self):
        both = Mesh(
            [[0, 0, 0], [1, 0, 0], [0, 1, 0]] * 2,
            [[0, 1, 2], [5, 4, 3]],
            normals=[[0, 0, 1]] * 3 + [[0, 0, -1]] * 3,
        )
        fine = tessellate(both, 4)
        assert np.abs(fine.vertices[:, 2]).max() == 0
        assert np.isfinite(fine.normals).all()

    def test_attributes_are_mixed(self):
        flat = sheet(2)
        shade = np.zeros((len(flat.vertices), 4), np.uint8)
        shade[:, 0] = np.rint(200 * flat.vertices[:, 0])
        texture = np.zeros((2, 2, 3), np.uint8)
        mesh = Mesh(flat.vertices, flat.faces, uv=flat.vertices[:, :2], vertex_colors=shade, texture=texture, name="s")
        fine = tessellate(mesh, 5)
        np.testing.assert_allclose(fine.uv, fine.vertices[:, :2], atol=1e-6)
        assert np.abs(fine.vertex_colors[:, 0] - 200 * fine.vertices[:, 0]).max() <= 0.51
        assert fine.texture is mesh.texture
        assert fine.name == "s"
        np.testing.assert_allclose(fine.normals, [[0, 0, 1]] * len(fine.normals), atol=1e-6)

    def test_degenerate_input(self):
        point = Mesh([[1, 1, 1]] * 3, [[0, 1, 2]])
        assert np.abs(tessellate(point, 3).vertices - 1).max() < 1e-15
        empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3)))
        assert tessellate(empty, 3) is empty
        nan = Mesh([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        with pytest.raises(SceneError, match="not finite"):
            tessellate(nan, 3)
        for level in (0, 65):
            with pytest.raises(SceneError, match="not between"):
                tessellate(ball(2), level)


class TestChain:
    def test_levels_and_errors(self, rng):
        mesh = ball(2, 0.1, smooth=True)
        chain = tessellation_chain(mesh, 8)
        assert [m.triangles for m, _ in chain] == [tessellated_triangles(mesh, n) for n in range(8, 0, -1)]
        errors = [e for _, e in chain]
        assert errors[0] == 0
        assert all(a < b for a, b in itertools.pairwise(errors))
        finest = chain[0][0]
        for level, error in chain[1:]:
            there = brute_distance(random_points(level, 3000, rng), finest).max()
            back = brute_distance(random_points(finest, 3000, rng), level).max()
            assert max(there, back) <= error * (1 + 1e-6)
        Lod(*(m for m, _ in chain), errors=errors)

    def test_twenty_levels_of_98_triangles(self):
        mesh = ball(3, 0.1, smooth=True)
        small = Mesh(mesh.vertices, mesh.faces[:98], normals=mesh.normals)
        chain = tessellation_chain(small)
        assert len(chain) == 20
        assert chain[0][0].triangles == 58_800
        assert chain[-1] == (small, chain[-1][1])
