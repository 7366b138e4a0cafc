"""pyvista in and out. Renderers without a window need no OpenGL; plotters do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkCommonDataModel import vtkPartitionedDataSetCollection
from vtkmodules.vtkCommonTransforms import vtkTransform
from vtkmodules.vtkRenderingCore import vtkActor, vtkAssembly, vtkPolyDataMapper, vtkRenderer, vtkVolume

from scenegraph.errors import SceneError
from scenegraph.exchange import from_pyvista, to_multiblock
from scenegraph.exchange.build import world_bounds
from scenegraph.mesh import Mesh
from scenegraph.nodes import Geode, Group, Lod, Switch, Transform
from scenegraph.occluder import Occluder
from scenegraph.scene import Scene

AWAY = np.array([4.5e6 + 0.1, 5.1e6 + 0.2, 100.3])


def geodes(scene: Scene) -> dict[str, Geode]:
    return {node.name: node for node in scene.root.walk() if isinstance(node, Geode)}


def actor_of(data: Any, **properties: Any) -> vtkActor:
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(data)
    mapper.ScalarVisibilityOff()
    actor = vtkActor()
    actor.SetMapper(mapper)
    for name, value in properties.items():
        getattr(actor.GetProperty(), f"Set{name}")(value)
    return actor


def renderer_of(*props: Any) -> vtkRenderer:
    renderer = vtkRenderer()
    for prop in props:
        renderer.AddViewProp(prop)
    return renderer


def triangles(geode: Geode) -> np.ndarray:
    matrix, above = np.eye(4), geode.parent
    while above is not None:
        if isinstance(above, Transform):
            matrix = above.matrix @ matrix
        above = above.parent
    return (geode.mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])[geode.mesh.faces]


@pytest.mark.parametrize(
    ("data", "count"),
    [
        (pv.Sphere(theta_resolution=8, phi_resolution=8), 96),
        (pv.Cube(), 12),
        (pv.Cube().cast_to_unstructured_grid(), 12),
        (pv.ImageData(dimensions=(3, 3, 3)), 48),
        (pv.ImageData(dimensions=(3, 3, 3)).cast_to_structured_grid(), 48),
        (pv.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid(), 48),
        (pv.RectilinearGrid([0.0, 1, 2], [0.0, 1, 2], [0.0, 1, 2]), 48),
        (pv.Plane(i_resolution=2, j_resolution=3).triangulate().strip(), 12),
        (pv.Disc(inner=0.2, c_res=8).merge(pv.Line()), 16),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, int) else str(value),
)
def test_data_sets_give_their_outer_triangles(data: Any, count: int) -> None:
    (geode,) = geodes(from_pyvista(data, name="thing")).values()
    assert geode.mesh.triangles == count
    assert geode.name == "thing"
    assert geode.source is data
    np.testing.assert_allclose(geode.mesh.bounds.T.ravel(), data.bounds)


def test_triangles_keep_their_order_and_float64() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.1]]) + AWAY
    data = pv.PolyData.from_regular_faces(points, [[3, 1, 2], [0, 1, 2]])
    scene = from_pyvista(data)
    (geode,) = geodes(scene).values()
    np.testing.assert_array_equal(triangles(geode), points[[[3, 1, 2], [0, 1, 2]]])
    assert np.abs(geode.mesh.vertices).max() < 200
    grid = pv.ImageData(dimensions=(2, 2, 2), origin=AWAY)
    (geode,) = geodes(from_pyvista(grid)).values()
    np.testing.assert_array_equal(triangles(geode).min(axis=(0, 1)), AWAY)


def test_blocks_keep_their_names_and_nesting_and_share_data() -> None:
    ball = pv.Sphere(theta_resolution=8, phi_resolution=8)
    blocks = pv.MultiBlock({"a": ball, "b": pv.MultiBlock({"c": ball, "d": pv.Cube()}), "none": None})
    scene = from_pyvista(blocks, name="m")
    found = geodes(scene)
    assert [g.path() for g in found.values()] == ["/m/a", "/m/b/c", "/m/b/d"]
    assert found["a"].mesh is found["c"].mesh
    assert found["a"].source is ball


def test_partitioned_data() -> None:
    collection = vtkPartitionedDataSetCollection()
    collection.SetPartition(0, 0, pv.Cube())
    collection.SetPartition(1, 0, pv.Cube())
    assert sum(g.mesh.triangles for g in from_pyvista(collection).root.walk() if isinstance(g, Geode)) == 24


def test_colors_of_data_sets() -> None:
    cube = pv.Cube().triangulate().clean()
    per_point = cube.copy()
    per_point.point_data["rgb"] = np.arange(cube.n_points * 3, dtype=np.uint8).reshape(-1, 3)
    per_point.set_active_scalars("rgb", preference="point")
    (geode,) = geodes(from_pyvista(per_point)).values()
    assert geode.mesh.vertex_colors is not None
    np.testing.assert_array_equal(geode.mesh.vertex_colors[:, :3], per_point.point_data["rgb"])
    mixed = pv.PolyData([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], faces=[4, 0, 1, 2, 3], lines=[2, 0, 1])
    mixed.cell_data["rgba"] = np.array([[9, 9, 9, 9], [1, 2, 3, 4]], np.uint8)
    mixed.set_active_scalars("rgba", preference="cell")
    (geode,) = geodes(from_pyvista(mixed)).values()
    assert geode.mesh.color is not None
    np.testing.assert_allclose(np.array(geode.mesh.color) * 255, [1, 2, 3, 4])
    numbers = pv.Cube()
    numbers.cell_data["height"] = np.arange(6.0)
    (geode,) = geodes(from_pyvista(numbers)).values()
    assert geode.mesh.vertex_colors is None, "numbers are not colors without a lookup table"


@pytest.mark.parametrize("faces", [[3, 0, 1, 2, 3, 0, 2, 3], [4, 0, 1, 2, 3, 3, 0, 1, 2]], ids=["triangles", "mixed"])
def test_colors_of_cells_follow_their_cells_past_lines(faces: list[int]) -> None:
    data = pv.PolyData([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], faces=faces, lines=[2, 0, 1])
    data.cell_data["rgba"] = np.array([[9, 9, 9, 9], [1, 2, 3, 255], [5, 6, 7, 255]], np.uint8)
    plotter = pv.Plotter(off_screen=True)
    plotter.add_mesh(data, scalars="rgba", rgb=True, preference="cell")
    (geode,) = geodes(from_pyvista(plotter)).values()
    plotter.close()
    mesh = geode.mesh
    assert mesh.vertex_colors is not None
    found = [tuple(mesh.vertex_colors[face[0]].tolist()) for face in mesh.faces]
    assert all((mesh.vertex_colors[face] == mesh.vertex_colors[face[0]]).all() for face in mesh.faces)
    first = 1 if faces[0] == 3 else 2
    assert found == [(1, 2, 3, 255)] * first + [(5, 6, 7, 255)]


@pytest.mark.parametrize(
    "source", [pv.MultiBlock(), pv.PolyData(), pv.PolyData([[0.0, 0, 0]]), pv.Line(), vtkRenderer()]
)
def test_nothing_to_draw_is_refused(source: Any) -> None:
    with pytest.raises(SceneError, match="has no triangles to draw"):
        from_pyvista(source)


@pytest.mark.parametrize("source", [None, 3, "plot", [pv.Cube()]])
def test_other_things_are_refused(source: Any) -> None:
    with pytest.raises(SceneError, match=r"from_pyvista got .*; give a pyvista Plotter"):
        from_pyvista(source)


def test_an_actor_stands_where_vtk_draws_it() -> None:
    actor = actor_of(pv.Cube(), Color=(1, 0.5, 0), Opacity=0.25)
    actor.SetOrigin(1, 2, 3)
    actor.SetPosition(10, 20, 30)
    actor.SetOrientation(20, 30, 40)
    actor.SetScale(1, -2, 3)
    user = vtkTransform()
    user.Translate(5.4e6, 0, 0)
    user.RotateZ(45)
    actor.SetUserTransform(user)
    scene = from_pyvista(renderer_of(actor))
    (geode,) = geodes(scene).values()
    assert geode.source is actor
    assert geode.color == (1.0, 0.5, 0.0, 0.25)
    found = triangles(geode)
    np.testing.assert_allclose(
        np.stack([found.min(axis=(0, 1)), found.max(axis=(0, 1))], 1).ravel(), actor.GetBounds(), rtol=1e-12
    )


def test_actors_of_the_same_data_share_a_mesh() -> None:
    ball = pv.Sphere(theta_resolution=8, phi_resolution=8)
    actors = [actor_of(ball, Color=(1, 0, 0)), actor_of(ball, Color=(0, 1, 0)), actor_of(ball.copy())]
    actors[1].SetPosition(3, 0, 0)
    found = list(geodes(from_pyvista(renderer_of(*actors))).values())
    assert found[0].mesh is found[1].mesh
    assert found[0].mesh is not found[2].mesh
    assert [g.source for g in found] == actors
    assert isinstance(found[1].parent, Transform)


def test_an_invisible_actor_is_switched_off() -> None:
    actor = actor_of(pv.Cube())
    actor.VisibilityOff()
    scene = from_pyvista(renderer_of(actor, actor_of(pv.Sphere())))
    (switch,) = [n for n in scene.root.walk() if isinstance(n, Switch)]
    assert switch.active == "none"
    assert scene.snapshot().n == 1
    switch.active = "all"
    assert scene.snapshot().n == 2


def test_normals_are_taken_where_the_actor_is_shaded_smoothly() -> None:
    ball = pv.Sphere(theta_resolution=8, phi_resolution=8)
    smooth, flat = actor_of(ball), actor_of(ball)
    flat.GetProperty().SetInterpolationToFlat()
    found = list(geodes(from_pyvista(renderer_of(smooth, flat))).values())
    assert found[0].mesh.normals is not None
    np.testing.assert_array_equal(found[0].mesh.normals, ball.point_data.active_normals)
    assert found[1].mesh.normals is None


def test_assemblies() -> None:
    assembly, part = vtkAssembly(), actor_of(pv.Cube())
    part.SetPosition(0, 1, 0)
    assembly.AddPart(part)
    assembly.AddPart(actor_of(pv.Cube()))
    assembly.SetPosition(10, 0, 0)
    assembly.RotateZ(90)
    scene = from_pyvista(renderer_of(assembly))
    bounds = [triangles(g).mean(axis=(0, 1)) for g in geodes(scene).values()]
    np.testing.assert_allclose(bounds, [[9, 0, 0], [10, 0, 0]], atol=1e-12)


def test_what_is_left_out_is_named() -> None:
    tilted = actor_of(pv.Cube())
    user = vtkTransform()
    user.SetMatrix([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.5, 0, 0, 1])
    tilted.SetUserTransform(user)
    flat = actor_of(pv.Cube())
    flat.SetScale(1, 0, 1)
    flat.SetUserTransform(None)
    scene = from_pyvista(renderer_of(actor_of(pv.Cube()), vtkVolume(), actor_of(pv.Line()), tilted, vtkActor()))
    assert len(geodes(scene)) == 1
    text = "\n".join(scene.problems)
    assert "(volume)" in text
    assert "(PolyData of 2 points)" in text
    assert "last row is not 0 0 0 1" in text


@pytest.mark.gl
class TestPlotter:
    @pytest.fixture
    def plotter(self) -> Any:
        plotter = pv.Plotter(off_screen=True, window_size=(400, 300))
        yield plotter
        plotter.close()

    def test_actors_names_camera_and_background(self, plotter: Any) -> None:
        plotter.background_color = (0.2, 0.4, 0.6)
        actor = plotter.add_mesh(pv.Cube(), name="crate", color="red")
        plotter.add_mesh(pv.Sphere())
        plotter.add_axes()
        plotter.add_text("hello")
        plotter.camera.position = (9, 8, 7)
        plotter.camera.clipping_range = (1, 99)
        scene = from_pyvista(plotter)
        found = geodes(scene)
        assert found["crate"].source is actor
        assert found["crate"].color == (1.0, 0.0, 0.0, 1.0)
        assert len(found) == 2
        assert not any("0x" in name for name in found), "names are the same in every run"
        assert scene.views["camera"].eye == (9, 8, 7)
        assert (scene.views["camera"].width, scene.views["camera"].height) == (400, 300)
        np.testing.assert_allclose(scene.background, (0.2, 0.4, 0.6), atol=1 / 255)
        assert scene.problems == []

    @pytest.mark.parametrize("before", [False, True])
    def test_mapped_scalars_become_the_colors_that_are_drawn(self, plotter: Any, before: bool) -> None:
        cube = pv.Cube().triangulate().clean()
        values = np.arange(cube.n_points, dtype=float)
        actor = plotter.add_mesh(
            cube, scalars=values, cmap="viridis", clim=(0, 4), opacity=0.5, interpolate_before_map=before, name="c"
        )
        (geode,) = geodes(from_pyvista(plotter)).values()
        assert geode.mesh.vertex_colors is not None
        expected = actor.mapper.lookup_table.map_value
        np.testing.assert_allclose(
            geode.mesh.vertex_colors[:, :3], [[round(255 * c) for c in expected(v)[:3]] for v in values], atol=1
        )
        assert (geode.mesh.vertex_colors[:, 3] == 128).all()
        assert geode.color is None

    def test_cell_scalars(self, plotter: Any) -> None:
        plotter.add_mesh(pv.Cube(), scalars=np.arange(6.0), cmap="viridis", name="c")
        (geode,) = geodes(from_pyvista(plotter)).values()
        assert geode.mesh.vertex_colors is not None
        assert geode.mesh.triangles == 12
        assert len(np.unique(geode.mesh.vertex_colors, axis=0)) == 6

    def test_textures(self, plotter: Any) -> None:
        pixels = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
        plane = pv.Plane(i_resolution=1, j_resolution=1)
        plotter.add_mesh(plane, texture=pv.numpy_to_texture(pixels), name="p")
        (geode,) = geodes(from_pyvista(plotter)).values()
        assert geode.mesh.texture is not None
        assert geode.mesh.uv is not None
        np.testing.assert_array_equal(geode.mesh.texture, pixels)
        np.testing.assert_array_equal(geode.mesh.uv, plane.active_texture_coordinates)

    def test_composite_actors(self, plotter: Any) -> None:
        blocks = pv.MultiBlock({"a": pv.Sphere(), "b": pv.Cube(), "in": pv.MultiBlock({"c": pv.Cone()})})
        actor, mapper = plotter.add_composite(blocks, color="red", name="all")
        mapper.block_attr[2].color = "blue"
        mapper.block_attr[1].visible = False
        scene = from_pyvista(plotter)
        found = geodes(scene)
        assert [g.path() for g in found.values()] == ["/scene/all/a (hidden)/a", "/scene/all/b", "/scene/all/in/c"]
        assert [g.color for g in found.values()] == [(1, 0, 0, 1), (0, 0, 1, 1), (1, 0, 0, 1)]
        assert {id(g.source) for g in found.values()} == {id(actor)}

    def test_other_subplots_are_named(self) -> None:
        plotter = pv.Plotter(off_screen=True, shape=(1, 2))
        plotter.subplot(0, 1)
        plotter.add_mesh(pv.Cube())
        assert from_pyvista(plotter).problems == ["1 other subplots are left out; make one active to import it"]
        plotter.close()


def test_blocks_out_and_in_again() -> None:
    colors = np.arange(32, dtype=np.uint8).reshape(8, 4)
    box = Mesh.box((0, 0, 0), (1, 2, 3), name="box", color=(0.2, 0.4, 0.6, 0.8))
    painted = Mesh(box.vertices, box.faces, vertex_colors=colors, uv=box.vertices[:, :2])
    scene = Scene().add(
        Geode(box, name="plain"),
        Transform(Geode(painted, name="far"), name="far", translation=AWAY),
        Group(Group(name="empty"), Transform(Geode(box, name="green", color=(0, 1, 0)), name="t", scale=2), name="g"),
        Switch(Geode(box, name="off"), active="none", name="s"),
        Lod(box, Mesh.box((0, 0, 0), (9, 9, 9)), name="lod"),
        Occluder.box((0, 0, 0), (1, 1, 1)),
    )
    blocks = to_multiblock(scene)
    assert blocks.keys() == ["plain", "far", "g", "s", "lod"]
    assert blocks["g"].keys() == ["empty", "t"]
    assert blocks["far"].points.dtype == np.float64
    np.testing.assert_array_equal(blocks["far"].points, box.vertices + AWAY)
    np.testing.assert_array_equal(blocks["far"].point_data["colors"], colors)
    np.testing.assert_array_equal(blocks["lod"].bounds, (0, 1, 0, 2, 0, 3))
    back = from_pyvista(blocks)
    found = geodes(back)
    assert [g.path() for g in found.values()] == ["/scene/plain", "/scene/far/far", "/scene/g/t/green", "/scene/lod"]
    assert found["plain"].color == (0.2, 0.4, 0.6, 0.8)
    assert found["green"].color == (0, 1, 0, 1)
    np.testing.assert_array_equal(triangles(found["green"]), 2 * box.vertices[box.faces])
    np.testing.assert_array_equal(triangles(found["far"]), (box.vertices + AWAY)[box.faces])
    np.testing.assert_array_equal(found["far"].mesh.vertex_colors, colors)


def test_mirroring_keeps_the_outside_outside() -> None:
    ball = pv.Sphere(theta_resolution=8, phi_resolution=8)
    mesh = Mesh(ball.points, ball.regular_faces, normals=ball.point_normals)
    scene = Scene().add(Transform(Geode(mesh, name="b"), name="b", scale=(-1, 2, 3)))
    (block,) = to_multiblock(scene)
    assert block.volume == pytest.approx(6 * ball.volume, rel=1e-5)
    outward = (block.point_data["Normals"] * block.points).sum(axis=1)
    assert (outward > 0).all()
    assert block.compute_normals(auto_orient_normals=False, flip_normals=False).volume > 0


def test_singular_transforms_can_be_exported() -> None:
    mesh = Mesh.box((0, 0, 0), (1, 1, 1))
    smooth = Mesh(mesh.vertices, mesh.faces, normals=np.ones((8, 3)))
    (block,) = to_multiblock(Scene().add(Transform(Geode(smooth, name="x"), scale=(1, 1, 0), name="x")))
    assert block.bounds[4:] == (0, 0)
    np.testing.assert_allclose(block.point_data["Normals"], [[0, 0, 1]] * 8)


def test_bounds_of_a_grid_far_away_are_exact() -> None:
    scene = from_pyvista(pv.ImageData(dimensions=(3, 3, 3), origin=AWAY))
    np.testing.assert_array_equal(world_bounds(scene.root)[0], AWAY)
