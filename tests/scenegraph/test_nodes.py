"""The graph: building, editing, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

import scenegraph as sg

BOX = sg.Mesh.box((0, 0, 0), (1, 1, 1))


def test_path_find_and_walk() -> None:
    leaf = sg.Geode(BOX, name="leaf")
    root = sg.Group(sg.Transform(leaf, name="moved"), sg.Group(name="empty"), name="root")
    assert leaf.path() == "/root/moved/leaf"
    assert root.find("leaf") is leaf
    assert [n.name for n in root.walk()] == ["root", "moved", "leaf", "empty"]
    with pytest.raises(sg.SceneError, match="no node is named 'tree' below /root"):
        root.find("tree")


def test_a_node_has_one_parent_and_a_mesh_many_users() -> None:
    leaf = sg.Geode(BOX)
    group = sg.Group(leaf, sg.Geode(BOX))
    with pytest.raises(sg.SceneError, match="already has the parent"):
        sg.Group(leaf)
    group.remove(leaf)
    assert sg.Group(leaf).children == (leaf,)
    with pytest.raises(sg.SceneError, match="is not a child of"):
        group.remove(leaf)


def test_a_group_cannot_be_put_below_itself() -> None:
    inner = sg.Group(name="inner")
    outer = sg.Group(inner, name="outer")
    with pytest.raises(sg.SceneError, match="below itself"):
        inner.add(outer)
    with pytest.raises(sg.SceneError, match="below itself"):
        inner.add(inner) if inner.parent is None else outer.add(outer)


def test_what_is_not_a_node_is_refused_with_the_cure() -> None:
    with pytest.raises(sg.SceneError, match="wrap a mesh in Geode"):
        sg.Group(BOX)  # type: ignore[arg-type]
    with pytest.raises(sg.SceneError, match="Geode needs a scenegraph Mesh, got int"):
        sg.Geode(3)  # type: ignore[arg-type]


def test_transform_parts_apply_in_the_order_scale_rotation_translation() -> None:
    node = sg.Transform(translation=(10, 0, 0), rotation=(90, (0, 0, 1)), scale=(2, 1, 1))
    assert np.allclose(node.matrix @ (1, 0, 0, 1), (10, 2, 0, 1))
    assert np.allclose(node.matrix @ (0, 1, 0, 1), (9, 0, 0, 1))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sg.Transform(matrix=np.eye(3)), r"shape \(3, 3\), expected \(4, 4\)"),
        (lambda: sg.Transform(matrix=np.ones((4, 4))), "last row of the matrix"),
        (lambda: sg.Transform(matrix=np.eye(4), scale=2), "not both"),
        (lambda: sg.Switch(active="some"), "use 'all', 'none'"),
        (lambda: sg.Lod(), "has no levels"),
        (lambda: sg.Lod(BOX, BOX, errors=(1.0, 0.5)), "must not decrease"),
        (lambda: sg.Lod(BOX, errors=(0.0, 0.5)), "2 errors for 1 levels"),
        (lambda: sg.Geode(BOX, color=(255, 0, 0)), "between 0 and 1"),
    ],
)
def test_bad_arguments_get_one_sentence(make: object, message: str) -> None:
    with pytest.raises(sg.SceneError, match=message):
        make()  # type: ignore[operator]


@pytest.mark.parametrize(
    ("scale", "singular"), [((1, 1, 1), False), ((1e-9, 1e-9, 1e-9), False), ((1, 1, 0), True), ((-2, 1, 1), False)]
)
def test_singular_is_a_matter_of_shape_not_of_size(scale: tuple[float, ...], singular: bool) -> None:
    assert sg.Transform(scale=scale).is_singular is singular


def test_switch_takes_rows_out_and_puts_them_back() -> None:
    switch = sg.Switch(sg.Geode(BOX, name="a"), sg.Geode(BOX, name="b"), active=1)
    snapshot = sg.Scene(sg.Group(switch)).snapshot()
    assert [g.name for g in snapshot.geodes] == ["b"]
    for active, names in (("all", {"a", "b"}), ("none", set()), ({0}, {"a"}), ({7}, set())):
        switch.active = active  # type: ignore[assignment]
        assert "structure" in snapshot.sync()
        assert {g.name for g in snapshot.geodes} == names


def test_mesh_refuses_what_cannot_be_drawn_and_names_what_is_odd() -> None:
    with pytest.raises(sg.SceneError, match=r"names vertex 3 .* but there are 3 vertices"):
        sg.Mesh(np.zeros((3, 3)), [[0, 1, 3]])
    with pytest.raises(sg.SceneError, match="triangulate first"):
        sg.Mesh(np.zeros((4, 3)), [[0, 1, 2, 3]])
    with pytest.raises(sg.SceneError, match=r"normals have shape \(2, 3\)"):
        sg.Mesh(np.zeros((3, 3)), [[0, 1, 2]], normals=np.zeros((2, 3)))
    odd = sg.Mesh([[0, 0, np.nan], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]])
    assert odd.problems == ("2 of 3 vertices are not finite",)
    assert np.isnan(odd.bounds).all()


def test_mesh_is_immutable_and_its_key_tells_content() -> None:
    with pytest.raises(ValueError, match="read-only"):
        BOX.vertices[0] = 1
    assert BOX.key == sg.Mesh.box((0, 0, 0), (1, 1, 1), name="other").key
    assert BOX.key != sg.Mesh.box((0, 0, 0), (1, 1, 2)).key
    assert BOX.triangles == 12
    assert sg.Mesh.merge([BOX, BOX]).triangles == 24


def test_box_mesh_is_closed_and_faces_outward() -> None:
    tri = BOX.vertices[BOX.faces]
    assert np.isclose(np.einsum("ij,ij->", tri[:, 0], np.cross(tri[:, 1], tri[:, 2])) / 6, 1.0)
