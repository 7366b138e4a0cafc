"""Tables of stand-ins: pictures equal those of the same meshes as rows, and own passes draw the same depth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from scenegraph import Frame, Geode, Group, Mesh, MeshTable, Scene, Transform, View
from scenegraph.render.device import Device
from scenegraph.render.drawing import Drawing
from scenegraph.render.standins import TableGeometry
from scenegraph.render.window import OffscreenWindow
from scenegraph.testing import box_at

pytestmark = pytest.mark.gl
SIZE = (320, 240)
VIEW = View((4, -14, 6), (4, 0, 0), near=1, far=60, width=SIZE[0], height=SIZE[1])


@pytest.fixture
def window() -> Iterator[OffscreenWindow]:
    with OffscreenWindow(*SIZE) as made:
        yield made


def meshes() -> list[Mesh]:
    rng = np.random.default_rng(5)
    found = []
    for i in range(10):
        box = Mesh.box((i - 0.45, -1, -1), (i + 0.45, 1, 1 + 0.2 * i))
        paint = None if i % 3 else rng.integers(0, 255, (8, 4)).astype(np.uint8) | np.uint8((0, 0, 0, 255))
        color = None if paint is not None else (*rng.random(3), 0.5 if i == 4 else 1.0)
        normals = box.vertices / np.linalg.norm(box.vertices, axis=1)[:, None] if i % 2 else None
        found.append(Mesh(box.vertices, box.faces, color=color, vertex_colors=paint, normals=normals))
    return found


def picture(window: OffscreenWindow, scene: Scene) -> np.ndarray:
    drawing = Drawing(scene.snapshot(), window.renderer)
    window.draw(VIEW)
    image = window.image()
    drawing.remove()
    return image


def as_rows(parts: list[Mesh]) -> Scene:
    return Scene(Group(*[Geode(m, color=m.color or (1, 1, 1)) for m in parts]))


def test_any_choice_looks_like_rows_and_swaps_without_new_actors(window: OffscreenWindow) -> None:
    table = MeshTable(meshes())
    snapshot = Scene().add(box_at((40, 0, 0)), box_at((44, 0, 0))).snapshot()
    drawing = Drawing(snapshot, window.renderer)
    counts = set()
    for chosen in ([0, 1, 2, 5], [3, 9], [7], list(range(10)), []):
        frame = Frame(snapshot, VIEW)
        frame.replace([0, 1], table, chosen=chosen)
        drawing.apply(frame)
        window.draw(VIEW)
        drawn = window.image()
        counts.add(drawing.actor_count)
        with OffscreenWindow(*SIZE) as other:
            expected = picture(other, as_rows([table.meshes[i] for i in chosen]))
        assert np.count_nonzero((drawn != expected).any(axis=2)) <= 8, chosen
    assert len(counts) == 1
    drawing.apply(Frame(snapshot, VIEW))
    window.draw(VIEW)
    assert (window.image() == window.image()[0, 0]).all()


def test_one_table_in_two_choices_at_three_places(window: OffscreenWindow) -> None:
    table = MeshTable(meshes()[:3])
    snapshot = Scene().add(*[box_at((40 + i, 0, 0)) for i in range(3)]).snapshot()
    drawing = Drawing(snapshot, window.renderer)
    frame = Frame(snapshot, VIEW)
    places = [Transform(translation=(3.0 * i, i, 0)).matrix for i in range(3)]
    for row, (place, chosen) in enumerate(zip(places, ([0, 1], [2], [0, 1]), strict=True)):
        frame.replace([row], table, place, chosen=chosen)
    drawing.apply(frame)
    window.draw(VIEW)
    drawn = window.image()
    parts = [(places[0], (0, 1)), (places[1], (2,)), (places[2], (0, 1))]
    nodes = [
        Transform(*[Geode(table.meshes[i], color=table.meshes[i].color or (1, 1, 1)) for i in some], matrix=m)
        for m, some in parts
    ]
    with OffscreenWindow(*SIZE) as other:
        expected = picture(other, Scene(Group(*nodes)))
    assert np.count_nonzero((drawn != expected).any(axis=2)) <= 8
    assert frame.drawn_objects == 5
    assert frame.drawn_triangles() == 60


@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_own_passes_draw_the_same_depth_as_rows(window: OffscreenWindow, offset: float) -> None:
    parts = [Mesh(m.vertices + offset, m.faces, color=m.color) for m in meshes()]
    view = VIEW.moved(eye=np.add(VIEW.eye, offset), target=np.add(VIEW.target, offset))
    table = MeshTable(parts)
    device = Device(window)
    for chosen in ([0, 4, 2], [9], list(range(10))):
        scene = as_rows([parts[i] for i in chosen])
        with device.guard():
            target = device.depth_target(*SIZE)
            device.draw_depth_of(target, view, table, np.array(chosen), clear=True)
            mine = target.read().copy()
            device.draw_depth(target, view, scene.snapshot())
            rows = target.read()
        assert np.count_nonzero(np.abs(mine - rows) > 1e-6) <= 8
        assert (mine < 1).any()
    device.close()


def test_layout_is_shared_as_long_as_somebody_holds_it() -> None:
    table = MeshTable(meshes())
    held = TableGeometry.shared(table)
    assert TableGeometry.shared(table) is held
    assert sum(len(b.faces) for b in held.batches) == table.triangles.sum()
    assert [b.material.translucent for b in held.batches] == sorted(b.material.translucent for b in held.batches)


def test_hostile_tables_are_drawn_as_far_as_they_can_be(window: OffscreenWindow) -> None:
    lost = Mesh([[0, 0, 0], [1, 0, 0], [0, np.nan, 1]], [[0, 1, 2]])
    snapshot = Scene().add(box_at((40, 0, 0))).snapshot()
    drawing = Drawing(snapshot, window.renderer)
    for parts in ([], [Mesh([], [])], [lost], [lost, Mesh.box((0, 0, 0), (1, 1, 1)), Mesh([], [])]):
        frame = Frame(snapshot, VIEW)
        frame.replace([0], MeshTable(parts))
        drawing.apply(frame)
        window.draw(VIEW)
        assert (window.image() != window.image()[0, 0]).any() == (len(parts) == 3)
