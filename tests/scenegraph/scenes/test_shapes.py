"""Pieces of surface: closed where they should be, and facing outward."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from scenegraph import Mesh, Occluder, Registry, Scene, scenes
from scenegraph.scenes import furniture
from scenegraph.scenes.buildings import apartments, offices, tower
from scenegraph.scenes.houses import house
from scenegraph.scenes.relief import Wall, ring
from scenegraph.scenes.shapes import Shape, face_occluders, icosphere, lathe, occluder_copy, placements, shrunk


def solid_of(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.round(mesh.vertices, 9), mesh.faces)


def test_boxes_and_prisms_are_closed_and_face_outward() -> None:
    box = solid_of(Shape().boxes([(0, 0, 0), (5, 5, 5)], [(1, 2, 3), (6, 6, 6)]).mesh())
    assert box.is_watertight
    assert box.volume == pytest.approx(7.0)
    section = np.array([(0, 0), (4, 0), (4, 2), (2, 4), (0, 2)])
    for ends in ((0.0, 3.0), (3.0, 0.0)):
        prism = solid_of(Shape().prism(*(np.insert(section, 0, x, axis=1) for x in ends)).mesh())
        assert prism.is_watertight
        assert prism.volume == pytest.approx(12 * 3)


@pytest.mark.parametrize("flute", [0.0, 0.2])
def test_a_lathe_that_ends_on_its_axis_is_closed(flute: float) -> None:
    points, faces = lathe([(0, 0), (2, 0), (2, 3), (0, 3)], 40, flute=flute)
    solid = trimesh.Trimesh(points, faces)
    assert solid.is_watertight
    assert 0 < solid.volume <= np.pi * 4 * 3
    assert solid.volume > (1 - flute) * 0.98 * np.pi * 4 * 3


@pytest.mark.parametrize("levels", [0, 1, 3])
def test_an_icosphere_is_a_sphere(levels: int) -> None:
    points, faces = icosphere(levels)
    assert len(faces) == 20 * 4**levels
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    solid = trimesh.Trimesh(points, faces)
    assert solid.is_watertight
    assert solid.volume > 2.5


@pytest.mark.parametrize("side", ["-x", "+x", "-y", "+y"])
def test_a_wall_puts_relief_outside_with_its_faces_outward(side: str) -> None:
    wall = Wall(side, (5.0, 3.0))
    shape = Shape()
    wall.boxes(shape, (np.array([-2.0, 0.5]), np.array([-1.0, 2.0])), (0.0, 0.4), (1.0, 2.0), "olrtb")
    wall.panels(shape, (-0.2, 0.2), 0.1, (0.0, 1.0))
    mesh = shape.mesh()
    axis, sign = "xy".index(side[1]), (-1 if side[0] == "-" else 1)
    out = sign * mesh.vertices[:, axis] - (5.0, 3.0)[axis]
    assert out.min() == pytest.approx(0.0)
    assert out.max() == pytest.approx(0.4)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    assert (sign * normal[:, axis] > -1e-12).all()
    assert (sign * normal[-2:, axis] > 0).all()
    # u runs to the right of someone who looks at the wall
    right = wall.points(1.0, 0.0, 0.0) - wall.points(0.0, 0.0, 0.0)
    outward = wall.points(0.0, 1.0, 0.0) - wall.points(0.0, 0.0, 0.0)
    assert np.allclose(np.cross(right, (0, 0, 1)), outward)


def test_a_ring_with_all_its_faces_is_closed() -> None:
    shape = Shape()
    ring(shape, (4.0, 2.0), (np.array([0.0, 3.0]), np.array([1.0, 5.0])), 0.5, "otbi", inner=-0.25)
    solid = solid_of(shape.mesh())
    assert solid.is_watertight
    assert solid.volume == pytest.approx((9 * 5 - 7.5 * 3.5) * 3)


@given(
    radii=st.lists(st.floats(1, 5), min_size=5, max_size=5),
    by=st.floats(0.001, 0.3),
)
def test_a_shrunk_polygon_keeps_its_distance(radii: list[float], by: float) -> None:
    angle = 2 * np.pi * np.arange(5) / 5
    ellipse = np.column_stack([radii[0] * np.cos(angle), radii[1] * np.sin(angle)])
    inner = shrunk(ellipse, by)
    edge = np.roll(ellipse, -1, axis=0) - ellipse
    inward = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.linalg.norm(edge, axis=1, keepdims=True)
    depth = inner @ inward.T - (inward * ellipse).sum(axis=1)
    assert np.allclose(depth.min(axis=1), by)


def test_face_occluders_look_outward_and_leave_out_floor_and_flat_top() -> None:
    solid = Occluder.box((0, 0, 0), (2, 3, 4))
    faces = face_occluders(solid)
    assert len(faces) == 4
    for face in faces:
        p = face.vertices
        normal = np.cross(p[1] - p[0], p[2] - p[1])
        assert normal @ (p.mean(axis=0) - solid.vertices.mean(axis=0)) > 0
        assert not face.two_sided
    house_like = np.array([[x, y, z] for x in (0, 5) for y, z in ((-2, 0), (2, 0), (2, 3), (0, 5), (-2, 3))], float)
    assert len(face_occluders(Occluder.solid(house_like))) == 6


def test_a_copied_occluder_shares_its_arrays() -> None:
    first = Occluder.planar([(0, 0, 0), (1, 0, 0), (1, 1, 0)], two_sided=False, name="a")
    second = occluder_copy(first)
    assert second is not first
    assert second.vertices is first.vertices
    assert (second.kind, second.faces, second.two_sided, second.name) == ("planar", first.faces, False, "a")


def test_placements_scale_turn_and_move() -> None:
    m = placements([(1, 2, 3), (4, 5, 6)], angle=[90, 0], scale=[(2, 1, 1), (1, 1, 3)])
    assert np.allclose(m[0] @ (1, 0, 0, 1), (1, 4, 3, 1))
    assert np.allclose(m[1] @ (0, 0, 1, 1), (4, 5, 9, 1))


@pytest.mark.parametrize("detail", [1, 2])
@pytest.mark.parametrize("corner", [-1, 0, 1])
def test_patterns_have_closed_bodies_and_stay_on_their_lot(detail: int, corner: int, rng: np.random.Generator) -> None:
    made = [house((4, 3), 3, corner, detail), apartments((4, 3), 5, corner, detail, rng)]
    made += [offices((4, 3), 8, detail, rng), tower((4, 3), 20, detail, rng)]
    for pattern in made:
        width, depth, height = pattern.size
        whole = Mesh.merge([pattern.body, pattern.facade, pattern.roof])
        assert np.abs(whole.vertices[:, 0]).max() <= width / 2 + 0.6
        assert np.abs(whole.vertices[:, 1]).max() <= depth / 2 + 0.6
        assert pattern.body.bounds[1, 2] >= height
        assert pattern.roof.bounds[1, 2] > height
        pieces = solid_of(pattern.body).split(only_watertight=True)
        assert sum(p.volume for p in pieces) > 0.45 * width * depth * height
        assert all(p.volume > 0 for p in pieces)
        solids = [o for o in pattern.occluders if o.kind == "solid"]
        assert pattern.only("solid").occluders == tuple(solids)
        hidden = sum(np.prod(np.ptp(o.vertices, axis=0)) for o in solids)
        assert hidden > 0.9 * sum(p.volume for p in pieces)


@pytest.mark.parametrize(
    "make",
    [
        furniture.broadleaf,
        furniture.conifer,
        furniture.olive,
        furniture.bush,
        lambda rng: furniture.conifer(rng, slim=True),
        lambda rng: furniture.statue(rng, color=(0.5, 0.5, 0.5)),
        lambda rng: furniture.street_lamp(),
        lambda rng: furniture.car((1.0, 0.0, 0.0)),
        lambda rng: furniture.fountain(),
    ],
)
def test_furniture_stands_on_the_ground_and_is_small(make: object, rng: np.random.Generator) -> None:
    mesh = make(rng)  # type: ignore[operator]
    assert mesh.triangles <= 450
    assert mesh.is_finite
    assert -0.4 < mesh.bounds[0, 2] < 0.1
    assert mesh.vertex_colors is not None


def test_the_built_in_scenes_register_through_the_hook() -> None:
    registry = Registry(discover=False)
    registry.add(scenes)
    assert not registry.failures
    bunnies = {"bunnies-5001", "bunnies-10001"}
    assert set(registry.scenes) == {"city", "olympia", "scatter", "foliage", "inspection"} | bunnies
    for entry in registry.scenes.values():
        assert entry.summary.endswith(".")
        assert all(o.kind is inspect.Parameter.KEYWORD_ONLY for o in entry.options.values())
        assert all(o.default is not inspect.Parameter.empty for o in entry.options.values())
        assert entry.build.__doc__ is not None
        assert all(f"\n    {name} : " in entry.build.__doc__ for name in entry.options)


@pytest.mark.parametrize(("name", "option"), [("city", "buildings"), ("olympia", "trees"), ("scatter", "count")])
def test_every_scene_has_two_paths_of_distinct_views(name: str, option: str) -> None:
    registry = Registry(discover=False)
    registry.add(scenes)
    scene = registry.scene(name).build(**{option: 20})
    assert isinstance(scene, Scene)
    assert len(scene.paths) == 2
    for path in scene.paths.values():
        assert len({v.eye for v in path}) == len(path)
        for view in path:
            assert np.isfinite(view.planes()).all()
