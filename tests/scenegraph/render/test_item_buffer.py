"""The item buffer against its independent twin, at any distance from the origin and any number of rows."""

from __future__ import annotations

import builtins
from typing import Any

import numpy as np
import pytest

from drawn_scenes import BOX, FAR, town, town_views
from scenegraph import Geode, Group, Mesh, Scene, Transform, View
from scenegraph.render import item_buffer as module
from scenegraph.render.drawing import Drawing
from scenegraph.render.flat_item_buffer import FlatItemBuffer
from scenegraph.render.item_buffer import ItemBuffer
from scenegraph.render.window import OffscreenWindow
from scenegraph.snapshot import Snapshot

pytestmark = pytest.mark.gl
Offset = tuple[float, float, float]
HERE = (0.0, 0.0, 0.0)


def flat_counts(snapshot: Snapshot, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Pixels per row and the picture of rows, by VTK's actors."""
    flat = FlatItemBuffer(snapshot)
    numbers, extra = flat.render(view)
    flat.close()
    return np.bincount(numbers.reshape(-1), minlength=snapshot.n + 1)[1:] + extra, numbers.astype(int) - 1


@pytest.mark.parametrize("offset", [HERE, FAR])
@pytest.mark.parametrize("name", town_views())
def test_agrees_with_flat_actors_on_every_row(offset: Offset, name: str) -> None:
    snapshot, view = town(offset).snapshot(), town_views(offset)[name]
    buffer = ItemBuffer(snapshot)
    truth = buffer.render(view)
    assert buffer.is_independent_of_vtk
    buffer.close()
    pixels, ids = flat_counts(snapshot, view)
    assert np.array_equal(truth.ids, ids)
    opaque = snapshot.colors[:, 3] == 1
    assert np.array_equal(truth.pixels[opaque], pixels[opaque])
    assert np.array_equal(truth.visible, pixels > 0)
    # front and back of a translucent box are two fragments of one pixel
    assert (truth.pixels[~opaque] >= pixels[~opaque]).all()
    assert 0 < truth.visible.sum() < snapshot.n


@pytest.mark.parametrize("offset", [HERE, FAR])
def test_drawing_exactly_the_visible_rows_changes_no_pixel(window: OffscreenWindow, offset: Offset) -> None:
    snapshot = town(offset).snapshot()
    drawing, buffer = Drawing(snapshot, window.renderer), ItemBuffer(snapshot, window)
    for view in town_views(offset).values():
        drawing.restore()
        window.draw(view)
        whole = window.image()
        truth = buffer.render(view)
        drawing.show(truth.visible)
        window.draw(view)
        assert np.array_equal(window.image(), whole)
        # and each visible row is needed: without the largest one the picture is another
        without = truth.visible.copy()
        without[np.argmax(truth.pixels)] = False
        drawing.show(without)
        window.draw(view)
        assert not np.array_equal(window.image(), whole)


def test_does_not_depend_on_what_is_drawn_and_changes_nothing(window: OffscreenWindow) -> None:
    snapshot, view = town().snapshot(), town_views()["above"]
    drawing, buffer = Drawing(snapshot, window.renderer), ItemBuffer(snapshot, window)
    truth = buffer.render(view)
    half = np.arange(snapshot.n) % 2 == 0
    drawing.show(half)
    window.draw(view)
    image = window.image()
    assert np.array_equal(buffer.render(view).ids, truth.ids)
    window.draw(view)
    assert np.array_equal(window.image(), image)


def test_more_rows_than_two_bytes_can_number() -> None:
    side = 270  # 72 900 rows
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    group = Group(*[Transform(Geode(square), translation=(a, b, 0)) for a, b in zip(x.ravel(), y.ravel(), strict=True)])
    snapshot = Scene(group).snapshot()
    assert snapshot.n == side**2 > 65_536
    middle = (side / 2, side / 2, 0)
    view = View(
        (*middle[:2], 10), middle, (0, 1, 0), near=1, far=100, width=3 * side, height=3 * side, parallel_scale=side / 2
    )
    truth = ItemBuffer(snapshot).render(view)
    # every square covers 3 x 3 pixels, and the one that lies there
    assert (truth.pixels == 9).all()
    place = np.rint(snapshot.boxes[:2] - 0.5).astype(int)
    assert np.array_equal(truth.ids[::-1][3 * place[1] + 1, 3 * place[0] + 1], np.arange(snapshot.n))


def test_tiles_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot = town().snapshot()
    for view in town_views().values():
        whole = ItemBuffer(snapshot).render(view)
        monkeypatch.setattr(module, "TILE", 113)
        tiled = ItemBuffer(snapshot).render(view)
        monkeypatch.undo()
        assert np.array_equal(tiled.ids, whole.ids)
        assert np.array_equal(tiled.pixels, whole.pixels)


def test_supersampling_finds_more_and_keeps_proportions() -> None:
    snapshot, view = town(translucent=False).snapshot(), town_views()["above"].resized(160, 90)
    buffer = ItemBuffer(snapshot)
    once, four = buffer.render(view), buffer.render(view, supersample=4)
    assert four.ids.shape == (360, 640)
    assert four.pixels.sum() == np.count_nonzero(four.ids >= 0)
    assert np.count_nonzero(four.visible) > np.count_nonzero(once.visible)
    large = once.pixels > 100
    np.testing.assert_allclose(four.pixels[large] / 16, once.pixels[large], rtol=0.15)
    with pytest.raises(ValueError, match="supersample"):
        buffer.render(view, supersample=0)


def test_large_images() -> None:
    snapshot, view = town(translucent=False).snapshot(), town_views()["above"]
    buffer = ItemBuffer(snapshot)
    large = buffer.render(view.resized(7680, 4320))
    small = buffer.render(view.resized(480, 270))
    assert large.ids.shape == (4320, 7680)
    assert large.visible[small.pixels > 4].all()
    assert buffer.render(view.resized(1, 1)).ids.shape == (1, 1)


def test_sync(window: OffscreenWindow) -> None:
    scene, view = town(), town_views()["above"]
    snapshot = scene.snapshot()
    buffer = ItemBuffer(snapshot, window)
    before = buffer.render(view)
    parts = [n for n in scene.root.walk() if isinstance(n, Transform) and isinstance(n.children[0], Geode)]
    for part in parts[::3]:
        part.matrix = Transform(translation=(0, 0, 5)).matrix @ part.matrix
    snapshot.sync()
    buffer.sync()
    moved = buffer.render(view)
    assert not np.array_equal(moved.ids, before.ids)
    # a new snapshot has its rows in another order, and another origin: other bits, but the same picture
    again = scene.snapshot()
    keys, wanted = np.append(snapshot.keys, -1), np.append(again.keys, -1)
    assert np.count_nonzero(keys[moved.ids] != wanted[ItemBuffer(again).render(view).ids]) <= 100
    scene.add(Transform(Geode(BOX), translation=(0, -100, 20), scale=30.0))
    snapshot.sync()
    buffer.sync()
    assert len(buffer.render(view).pixels) == snapshot.n


def test_translucent_rows_do_not_hide_and_are_hidden() -> None:
    def at(y: float, name: str, alpha: float = 1.0) -> Transform:
        return Transform(Geode(BOX, name=name, color=(1, 1, 1, alpha)), translation=(0, y, -0.5))

    snapshot = Scene(Group(at(0, "glass", 0.5), at(2, "behind glass"), at(4, "far glass", 0.5))).snapshot()
    truth = ItemBuffer(snapshot).render(View((0, -5, 0), (0, 0, 0), near=0.1, far=100, width=100, height=100))
    seen = {g.name: bool(v) for g, v in zip(snapshot.geodes, truth.visible, strict=True)}
    assert seen == {"glass": True, "behind glass": True, "far glass": False}


def test_back_faces_count() -> None:
    snapshot = Scene(Group(Geode(BOX))).snapshot()
    truth = ItemBuffer(snapshot).render(View((0, 0, 0.5), (0, 1, 0.5), near=0.01, far=100, width=50, height=50))
    assert truth.pixels.tolist() == [2500]


def test_empty_scene() -> None:
    truth = ItemBuffer(Scene().snapshot()).render(View((0, 0, 0), (0, 1, 0), width=20, height=10))
    assert truth.pixels.shape == (0,)
    assert (truth.ids == -1).all()


def test_without_moderngl_vtk_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot, view = town().snapshot(), town_views()["street"]
    wanted = ItemBuffer(snapshot).render(view)
    original = builtins.__import__

    def missing(name: str, *rest: Any, **more: Any) -> Any:
        if name == "moderngl":
            raise ImportError(name)
        return original(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", missing)
    buffer = ItemBuffer(snapshot)
    found = buffer.render(view)
    assert not buffer.is_independent_of_vtk
    assert np.array_equal(found.ids, wanted.ids)
    assert np.array_equal(found.visible, wanted.visible)
    buffer.close()
    buffer.close()
