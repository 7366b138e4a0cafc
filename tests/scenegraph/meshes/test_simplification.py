"""Levels by edge collapse: how many triangles, how far off, and what they carry."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from level_shapes import ball, brute_distance, random_points, sheet, unwelded
from scenegraph import Lod, Mesh, SceneError
from scenegraph.meshes import DiskCache, level_chain, simplify
from scenegraph.meshes.deviation import Surface, surface_deviation


def chain(mesh, *args, **options):
    return level_chain(mesh, *args, cache=None, **options)


def two_sided(a: Mesh, b: Mesh, rng: np.random.Generator, count: int = 20_000) -> float:
    """Greatest distance found between points of two surfaces: never more than the true one."""
    there, back = random_points(a, count, rng), random_points(b, count, rng)
    there, back = np.concatenate([there, a.vertices]), np.concatenate([back, b.vertices])
    return float(max(brute_distance(there, b).max(), brute_distance(back, a).max()))


class TestDeviation:
    def test_two_planes(self):
        flat = sheet(6)
        triangles = flat.vertices[flat.faces]
        found = surface_deviation(triangles + (0, 0, 0.25), Surface(triangles))
        assert found.bound == pytest.approx(0.25)
        assert found.found == pytest.approx(0.25)

    def test_a_hole_counts_to_its_middle(self):
        flat = sheet(8)
        triangles = flat.vertices[flat.faces]
        middle = triangles.mean(axis=1)
        rim = triangles[np.abs(middle[:, :2] - 0.5).max(axis=1) > 0.25]
        found = surface_deviation(triangles, Surface(rim))
        assert 0.25 <= found.bound <= 0.25 * 1.1
        assert surface_deviation(rim, Surface(triangles)).bound == 0

    @settings(max_examples=20)
    @given(st.integers(0, 10**6), st.integers(1, 12), st.integers(1, 12))
    def test_no_point_is_farther_than_the_bound(self, seed, m, n):
        rng = np.random.default_rng(seed)
        a, b = rng.normal(size=(m, 3, 3)), rng.normal(size=(n, 3, 3))
        found = surface_deviation(a, Surface(b))
        soup = [Mesh(t.reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3)) for t in (a, b)]
        sampled = brute_distance(random_points(soup[0], 2000, rng), soup[1]).max()
        assert sampled <= found.bound * (1 + 1e-6)
        size = np.ptp(b.reshape(-1, 3), axis=0).max()
        assert found.bound <= max(1.1 * found.found, found.found + 2e-4 * size) * 1.001


class TestChain:
    def test_levels_hold_their_counts_and_their_errors(self, rng):
        mesh = ball(20, 0.1)
        levels = chain(mesh)
        counts = np.array([m.triangles for m, _ in levels])
        wanted = np.array([4800, 2400, 1200, 600, 300, 150, 75])
        assert ((counts <= wanted) & (counts >= wanted - 2)).all()
        errors = [e for _, e in levels]
        assert errors[0] == 0
        assert all(a <= b for a, b in itertools.pairwise(errors))
        for level, error in levels[1:]:
            measured = two_sided(mesh, level, rng)
            assert measured <= error * (1 + 1e-6)
        assert measured > 0.5 * error, "the last bound says something"
        Lod(*(m for m, _ in levels), errors=errors)

    def test_flat_parts_cost_nothing(self):
        box = trimesh.creation.box().subdivide().subdivide().subdivide()
        mesh = Mesh(box.vertices, box.faces)
        level, error = simplify(mesh, 40, cache=None)
        assert level.triangles <= 40
        assert error < 2.1e-4, "the floor of the measurement"

    def test_seams_stay_closed(self):
        mesh = unwelded(ball(10))
        level, error = simplify(mesh, 200, cache=None)
        assert level.triangles <= 200
        welded = trimesh.Trimesh(level.vertices, level.faces, process=True)
        welded.merge_vertices(merge_norm=True)
        assert welded.is_watertight
        assert error < 0.2

    def test_no_level_leaves_the_box_of_the_mesh(self):
        mesh = ball(12, 0.3)
        low, high = mesh.bounds
        for level, _ in chain(mesh):
            assert (level.vertices >= low).all()
            assert (level.vertices <= high).all()

    def test_borders(self):
        mesh = sheet(16, 0.05)
        free, fixed = simplify(mesh, 20, cache=None), simplify(mesh, 20, preserve_border=True, cache=None)
        assert free[0].triangles <= 20 < fixed[0].triangles
        assert np.isclose(fixed[0].bounds[:, :2], mesh.bounds[:, :2]).all()

    @pytest.mark.parametrize(("scale", "offset"), [(1e-9, 0.0), (1e-6, 1e-3), (1.0, 1e7), (1e6, 0.0), (1e3, 1e11)])
    def test_scale_and_shift(self, scale, offset):
        plain = ball(8, 0.1)
        mesh = Mesh(plain.vertices * scale + offset, plain.faces)
        expected, levels = chain(plain), chain(mesh)
        assert [m.triangles for m, _ in levels] == [m.triangles for m, _ in expected]
        for (_, a), (_, b) in zip(expected[1:], levels[1:], strict=True):
            assert b / scale == pytest.approx(a, rel=0.05, abs=4e-5 * offset / 1e7 if offset > 1e9 else 1e-6)

    def test_same_input_same_levels(self):
        for (a, e), (b, f) in zip(chain(ball(8, 0.1)), chain(ball(8, 0.1)), strict=True):
            assert e == f
            assert np.array_equal(a.vertices, b.vertices)
            assert np.array_equal(a.faces, b.faces)

    def test_what_cannot_be_coarser_is_left_alone(self):
        nan = np.array(ball(4).vertices)
        nan[0, 0] = np.nan
        for mesh in (
            Mesh(np.zeros((0, 3)), np.zeros((0, 3))),
            Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
            Mesh(np.zeros((300, 3)), np.arange(300).reshape(-1, 3)),
            Mesh(nan, ball(4).faces),
        ):
            assert chain(mesh) == [(mesh, 0.0)]
            assert simplify(mesh, 1, cache=None) == (mesh, 0.0)

    def test_faces_without_area_and_vertices_of_none_do_no_harm(self):
        plain = ball(6)
        faces = np.concatenate([plain.faces, np.repeat(plain.faces[:50, :1], 3, axis=1)])
        mesh = Mesh(np.concatenate([np.full((7, 3), 9.0), plain.vertices]), faces + 7)
        level, error = simplify(mesh, 100, cache=None)
        assert level.triangles <= 100
        assert error < 0.3
        assert np.abs(level.vertices).max() <= 1

    def test_bad_settings_are_refused(self):
        with pytest.raises(SceneError, match="ratios"):
            chain(ball(4), (0.5, 1.5))
        with pytest.raises(SceneError, match="fall"):
            chain(ball(4), counts=(10, 20))

    def test_progress_rises_to_one(self):
        shares = []
        chain(ball(8), progress=lambda what, share: shares.append(share))
        assert shares == sorted(shares)
        assert shares[-1] == 1

    def test_cancelling_is_possible(self):
        def stop(what, share):
            if share > 0.3:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            chain(ball(8), progress=stop)


class TestAttributes:
    def test_normals_follow_the_surface(self):
        level, _ = simplify(ball(16, smooth=True), 400, cache=None)
        assert level.normals is not None
        np.testing.assert_allclose(np.linalg.norm(level.normals, axis=1), 1, atol=1e-5)
        outward = level.vertices / np.linalg.norm(level.vertices, axis=1, keepdims=True)
        assert (level.normals * outward).sum(axis=1).min() > 0.95
        assert len(level.vertices) == level.triangles // 2 + 2, "a smooth ball has no seams"

    def test_creases_stay_sharp(self):
        box = trimesh.creation.box().subdivide().subdivide()
        smooth = Mesh(box.vertices, box.faces)
        mesh = unwelded(smooth)
        # one patch per side: corners that share a position and a normal are one vertex
        both, number = np.unique(np.column_stack([mesh.vertices, mesh.normals]), axis=0, return_inverse=True)
        mesh = Mesh(both[:, :3], number.reshape(-1, 3), normals=both[:, 3:])
        level, error = simplify(mesh, 24, cache=None)
        assert error < 2.1e-4, "the floor of the measurement"
        assert np.isclose(np.abs(level.normals).max(axis=1), 1).all(), "every normal is that of a side"
        p = level.vertices[level.faces]
        facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        area = np.linalg.norm(facing, axis=1)
        some = area > 1e-6
        facing = facing[some] / area[some, None]
        assert (level.normals[level.faces[some]] * facing[:, None]).sum(axis=2).min() > 0.99

    def test_colors_and_texture_coordinates(self):
        flat = sheet(20)
        shade = np.zeros((len(flat.vertices), 4), np.uint8)
        shade[:, 0], shade[:, 3] = np.rint(255 * flat.vertices[:, 0]), 255
        texture = np.zeros((2, 2, 3), np.uint8)
        mesh = Mesh(flat.vertices, flat.faces, vertex_colors=shade, uv=flat.vertices[:, :2], texture=texture)
        level, _ = simplify(mesh, 100, cache=None)
        assert level.texture is mesh.texture
        np.testing.assert_allclose(level.uv, level.vertices[:, :2], atol=1e-5)
        assert np.abs(level.vertex_colors[:, 0] - 255 * level.vertices[:, 0]).max() <= 1.01
        assert (level.vertex_colors[:, 3] == 255).all()

    def test_color_and_name_are_kept(self):
        level, _ = simplify(ball(6, color=(1, 0, 0), name="red"), 100, cache=None)
        assert level.color == (1, 0, 0, 1)
        assert level.name == "red"


class TestCache:
    def test_second_time_from_disk(self, tmp_path, monkeypatch):
        store = DiskCache(tmp_path)
        mesh = ball(8, 0.1, smooth=True)
        first = level_chain(mesh, cache=store)
        monkeypatch.setattr("scenegraph.meshes.simplification._levels", None)
        second = level_chain(mesh, cache=store)
        for (a, e), (b, f) in zip(first, second, strict=True):
            assert e == f
            assert np.array_equal(a.vertices, b.vertices)
            assert np.array_equal(a.faces, b.faces)
            assert np.array_equal(a.normals, b.normals)

    def test_other_attributes_are_another_entry(self, tmp_path):
        store = DiskCache(tmp_path)
        plain, smooth = ball(6), ball(6, smooth=True)
        assert level_chain(plain, cache=store)[1][0].normals is None
        assert level_chain(smooth, cache=store)[1][0].normals is not None

    def test_a_spoilt_entry_is_made_again(self, tmp_path):
        store = DiskCache(tmp_path)
        mesh = ball(6)
        level_chain(mesh, cache=store)
        (path,) = tmp_path.glob("levels/*.npz")
        arrays = dict(np.load(path))
        arrays["faces0"] = arrays["faces0"] + 10_000
        np.savez(path, **arrays)
        assert len(level_chain(mesh, cache=store)) > 1
        path.write_bytes(b"no")
        assert len(level_chain(mesh, cache=store)) > 1


@pytest.mark.data
def test_a_scan(data_dir, rng):
    scan = trimesh.load(data_dir / "meshes" / "bunny_res3.ply", process=False)
    mesh = Mesh(scan.vertices, scan.faces)
    for level, error in chain(mesh)[1:]:
        assert two_sided(mesh, level, rng, 5000) <= error
