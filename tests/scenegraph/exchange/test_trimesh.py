"""trimesh in and out: hierarchy, instances, exact matrices and coordinates, colors, cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis.extra.numpy import arrays
from PIL import Image

from scenegraph.errors import SceneError
from scenegraph.exchange import from_trimesh, load, to_trimesh
from scenegraph.exchange.build import world_bounds
from scenegraph.mesh import Mesh
from scenegraph.nodes import Geode, Group, Lod, Switch, Transform
from scenegraph.occluder import Occluder
from scenegraph.scene import Scene
from scenegraph.view import View

PIXELS = np.arange(2 * 4 * 3, dtype=np.uint8).reshape(2, 4, 3)


def geodes(scene: Scene) -> list[Geode]:
    return [node for node in scene.root.walk() if isinstance(node, Geode)]


def shape(scene: Scene) -> list[Any]:
    """Everything that a round trip has to keep, node by node."""
    out: list[Any] = []
    for node in scene.root.walk():
        if isinstance(node, Geode):
            mesh = node.mesh
            out.append((node.path(), mesh.name, mesh.vertices.tolist(), mesh.faces.tolist(), node.color or mesh.color))
        elif isinstance(node, Transform):
            out.append((node.path(), node.matrix.tolist()))
        else:
            out.append(node.path())
    return out


def sample() -> Scene:
    box = Mesh.box((0, 0, 0), (1, 2, 3), name="box", color=(0.2, 0.4, 0.6))
    turned = Transform(Geode(box, name="turned"), name="turned", rotation=(30, (1, 2, 3)), translation=(0.1, 0.2, 0.3))
    bent = np.eye(4)
    bent[0, 1] = 1e-7  # trimesh's repair of almost rigid matrices would undo this
    return Scene(
        Group(
            Geode(box, name="here"),
            turned,
            Transform(
                Transform(Geode(box, name="deep"), Geode(box, name="deeper"), name="inner", matrix=bent),
                name="outer",
                translation=(5.4e6, -1e11, 1e-9),
                scale=(1, -2, 3),
            ),
            Group(Group(name="empty"), Geode(box, name="below"), name="store"),
            name="scene",
        )
    )


def test_a_round_trip_keeps_hierarchy_names_matrices_and_sharing() -> None:
    scene = sample()
    back = from_trimesh(to_trimesh(scene))
    assert shape(back) == shape(scene)
    assert len({id(g.mesh) for g in geodes(back)}) == 1
    assert back.problems == []
    assert [g.source for g in geodes(back)] == ["here", "turned", "deep", "deeper", "below"]


def test_a_round_trip_through_a_file(tmp_path: Path) -> None:
    scene = sample()
    (tmp_path / "scene.glb").write_bytes(to_trimesh(scene).export(file_type="glb"))
    back = load(tmp_path / "scene.glb")
    assert [g.path() for g in geodes(back)] == [g.path() for g in geodes(scene)]
    assert len({id(g.mesh) for g in geodes(back)}) == 1
    assert geodes(back)[0].mesh.color == (0.2, 0.4, 0.6, 1.0)


@given(
    vertices=arrays(np.float64, (6, 3), elements=st.floats(-1e3, 1e3)),
    away=arrays(np.float64, 3, elements=st.floats(-1e9, 1e9)),
)
def test_coordinates_come_back_bit_for_bit(vertices: np.ndarray, away: np.ndarray) -> None:
    points = vertices + away
    mesh = trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5], [0, 2, 4]], process=False)
    out = to_trimesh(from_trimesh(mesh))
    (node,) = out.graph.nodes_geometry
    forest = out.graph.transforms
    world = np.asarray(out.geometry[forest.node_data[node]["geometry"]].vertices)
    while node in forest.parents:
        matrix = forest.edge_data[forest.parents[node], node]["matrix"]
        np.testing.assert_array_equal(matrix[:3, :3], np.eye(3))
        world = world + matrix[:3, 3]
        node = forest.parents[node]
    np.testing.assert_array_equal(world, points)


def test_a_flat_scene_far_away_has_one_origin() -> None:
    away = np.array([4.5e6, 5.1e6, 100.0])
    boxes = [trimesh.creation.box(bounds=[away + [i * 20, 0, 0], away + [i * 20 + 9, 9, 9]]) for i in range(6)]
    scene = from_trimesh(boxes)
    (origin,) = scene.root.children
    assert isinstance(origin, Transform)
    assert len(origin.children) == 6
    out = to_trimesh(scene)
    np.testing.assert_array_equal(out.bounds, [away, away + [109, 9, 9]])


def test_lists_and_single_meshes() -> None:
    box, ball = trimesh.creation.box(), trimesh.creation.icosphere(subdivisions=1)
    box.metadata["name"] = "crate"
    scene = from_trimesh([box, ball, box], name="pile")
    assert [g.path() for g in geodes(scene)] == ["/pile/crate", "/pile/mesh 1", "/pile/crate"]
    assert geodes(scene)[0].mesh is geodes(scene)[2].mesh
    assert geodes(scene)[0].source is box
    assert [g.name for g in geodes(from_trimesh({"a": box, "b": ball}))] == ["a", "b"]
    assert len(geodes(from_trimesh(ball))) == 1


@pytest.mark.parametrize("source", [trimesh.Scene(), [], trimesh.Trimesh(), trimesh.PointCloud([[0, 0, 0]])])
def test_nothing_to_draw_is_refused(source: Any) -> None:
    with pytest.raises(SceneError, match="has no triangles to draw"):
        from_trimesh(source)


@pytest.mark.parametrize("source", [42, ["box"], [trimesh.Scene()]])
def test_other_things_are_refused(source: Any) -> None:
    with pytest.raises(SceneError, match=r"from_trimesh got .*; give a trimesh\.Scene"):
        from_trimesh(source)


def test_what_is_left_out_is_named() -> None:
    source = trimesh.Scene()
    source.add_geometry(trimesh.creation.box(), node_name="box", geom_name="box")
    source.add_geometry(trimesh.PointCloud(np.zeros((7, 3))), node_name="cloud", geom_name="cloud")
    source.geometry["spare"] = trimesh.creation.box()
    source.graph.update("island", "nowhere", geometry="box")
    tilted = np.eye(4)
    tilted[3, 0] = 1
    source.graph.update("tilted", geometry="box", matrix=tilted)
    flat = np.diag([1.0, 0, 1, 1])
    source.graph.update("flat", geometry="box", matrix=flat)
    scene = from_trimesh(source)
    assert sorted(g.name for g in geodes(scene)) == ["box", "flat"]
    text = "\n".join(scene.problems)
    for expected in ("'cloud' (PointCloud of 7 points)", "'spare'", "'island'", "'tilted'", "'/scene/flat'"):
        assert expected in text


def test_nan_is_kept_counted_and_named() -> None:
    broken = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [np.nan, 1, 0]], [[0, 1, 2]], process=False)
    scene = from_trimesh({"broken": broken})
    assert geodes(scene)[0].mesh.triangles == 1
    assert scene.problems == ["vertices that are not finite, objects kept and always drawn: 'broken' (1 of 3)"]


def test_looks_survive() -> None:
    uv = np.array([[0, 0], [1, 0], [0, 1]], float)
    triangle: Any = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
    scene = Scene()
    colors = np.array([[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12]], np.uint8)
    scene.add(
        Geode(Mesh(**triangle, name="image", uv=uv, texture=PIXELS, color=(1, 0.2, 0))),
        Geode(Mesh(**triangle, name="colors", vertex_colors=colors)),
        Geode(Mesh(**triangle, name="both", uv=uv, texture=PIXELS, vertex_colors=colors)),
        Geode(Mesh(**triangle, name="glass", color=(0.2, 0.4, 0.6, 0.4))),
        Geode(Mesh(**triangle, name="bare")),
        Geode(Mesh(**triangle, name="smooth", normals=[[0, 0, 1]] * 3)),
    )
    found = {g.mesh.name: g.mesh for g in geodes(from_trimesh(to_trimesh(scene)))}
    for name in ("image", "both"):
        np.testing.assert_array_equal(found[name].texture, PIXELS)
        np.testing.assert_array_equal(found[name].uv, uv)
    for name in ("colors", "both"):
        np.testing.assert_array_equal(found[name].vertex_colors, colors)
    assert found["image"].color == (1.0, 0.2, 0.0, 1.0)
    assert found["glass"].color == (0.2, 0.4, 0.6, 0.4)
    assert found["bare"].color is None
    np.testing.assert_array_equal(found["smooth"].normals, [[0, 0, 1]] * 3)
    assert found["bare"].normals is None


def test_a_color_of_the_geode_wins_over_the_shared_mesh() -> None:
    box = Mesh.box((0, 0, 0), (1, 1, 1), color=(1, 0, 0))
    scene = Scene().add(Geode(box, name="a"), Geode(box, name="b", color=(0, 1, 0)), Geode(box, name="c"))
    out = to_trimesh(scene)
    assert len(out.geometry) == 2
    assert [g.mesh.color for g in geodes(from_trimesh(out))] == [(1, 0, 0, 1), (0, 1, 0, 1), (1, 0, 0, 1)]


def test_materials_of_trimesh() -> None:
    visual = trimesh.visual
    uv = np.zeros((8, 2))
    image = Image.fromarray(np.dstack([PIXELS, np.full((2, 4), 99, np.uint8)]))

    def box(material: Any) -> trimesh.Trimesh:
        made = trimesh.creation.box()
        made.visual = visual.TextureVisuals(uv=uv, material=material)
        return made

    pbr, simple = visual.material.PBRMaterial, visual.material.SimpleMaterial
    scene = from_trimesh(
        {
            "opaque": box(pbr(baseColorFactor=[255, 0, 0, 51], baseColorTexture=image)),
            "blend": box(pbr(baseColorFactor=[255, 0, 0, 51], baseColorTexture=image, alphaMode="BLEND")),
            "simple": box(simple(diffuse=[0, 255, 0, 255], image=image)),
            "default": box(simple()),
            "several": box(visual.material.MultiMaterial([simple(diffuse=[0, 0, 255, 255]), simple()])),
        }
    )
    found = {g.name: g.mesh for g in geodes(scene)}
    assert found["opaque"].color == (1, 0, 0, 1)
    assert found["opaque"].texture is not None
    assert found["opaque"].texture.shape == (2, 4, 3)
    assert found["blend"].color == (1, 0, 0, 0.2)
    assert found["blend"].texture is not None
    assert found["blend"].texture.shape == (2, 4, 4)
    assert found["simple"].color == (0, 1, 0, 1)
    assert found["simple"].texture is found["blend"].texture
    assert found["default"].color is None
    assert found["several"].color == (0, 0, 1, 1)


def test_switches_levels_and_occluders() -> None:
    box, coarse = Mesh.box((0, 0, 0), (1, 1, 1), name="fine"), Mesh.box((0, 0, 0), (2, 2, 2), name="coarse")
    scene = Scene().add(
        Switch(Geode(box, name="on"), Geode(box, name="off"), active=0, name="switch"),
        Lod(box, coarse, name="lod"),
        Occluder.box((0, 0, 0), (1, 1, 1), name="hider"),
    )
    out = to_trimesh(scene)
    assert sorted(out.graph.nodes_geometry) == ["lod", "on"]
    assert list(out.geometry) == ["fine"]


def test_names_that_clash_are_numbered() -> None:
    box = Mesh.box((0, 0, 0), (1, 1, 1))
    scene = Scene().add(
        Geode(box, name="world"), Geode(box, name="a"), Geode(box, name="a"), Geode(box, name="a_2"), Geode(box)
    )
    out = to_trimesh(scene)
    assert sorted(out.graph.nodes_geometry) == ["Geode", "a", "a_2", "a_2_2", "world_2"]


def test_a_moved_root_is_kept() -> None:
    scene = Scene(Transform(Geode(Mesh.box((0, 0, 0), (1, 1, 1), name="box")), translation=(1, 2, 3), name="root"))
    np.testing.assert_array_equal(to_trimesh(scene).bounds, [[1, 2, 3], [2, 3, 4]])
    lone = Scene(Group(Geode(Mesh.box((0, 0, 0), (1, 1, 1)), name="same"), name="same"))
    np.testing.assert_array_equal(to_trimesh(lone).bounds, [[0, 0, 0], [1, 1, 1]])


def test_the_camera_comes_back() -> None:
    scene = sample()
    scene.views["plan"] = View((0, 0, 9), (0, 0, 0), up=(0, 1, 0), parallel_scale=3)
    scene.views["street"] = View((1, 2, 3), (9, 2, 4), up=(0, 0, 1), fov=40, width=900, height=600, near=0.5, far=700)
    back = from_trimesh(to_trimesh(scene))
    (view,) = back.views.values()
    assert list(back.views) == ["street"]
    street = scene.views["street"]
    np.testing.assert_allclose(view.axes, street.axes, atol=1e-12)
    assert view.eye == street.eye
    assert view.fov == pytest.approx(40)
    assert (view.near, view.far) == (0.5, 700)
    assert view.aspect == pytest.approx(1.5)
    assert [n.path() for n in back.root.walk()] == [n.path() for n in scene.root.walk()]


def test_a_deep_chain() -> None:
    ball = trimesh.creation.box()
    source = trimesh.Scene()
    source.geometry["box"] = ball
    frame = source.graph.base_frame
    for i in range(2000):
        source.graph.update(f"n{i}", frame, matrix=trimesh.transformations.translation_matrix([1, 0, 0]))
        frame = f"n{i}"
    source.graph.update("end", frame, geometry="box")
    scene = from_trimesh(source)
    (end,) = geodes(scene)
    assert end.path().count("/") == 2002
    np.testing.assert_allclose(world_bounds(scene.root), [[1999.5, -0.5, -0.5], [2000.5, 0.5, 0.5]])
    assert len(to_trimesh(scene).graph.nodes) == 2002
