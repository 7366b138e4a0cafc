"""Drawing: both modes give the same picture, far from the origin too, whatever was hidden before."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from drawn_scenes import BOX, FAR, ball, town, town_views
from scenegraph import Frame, Geode, Group, Lod, Mesh, Scene, Switch, Transform, View
from scenegraph.render.drawing import Drawing
from scenegraph.render.window import OffscreenWindow

pytestmark = pytest.mark.gl
Offset = tuple[float, float, float]
HERE = (0.0, 0.0, 0.0)


def picture(window: OffscreenWindow, view: View) -> np.ndarray:
    window.draw(view)
    return window.image()


def fresh(scene: Scene, view: View, **options: object) -> np.ndarray:
    with OffscreenWindow(view.width, view.height) as window:
        Drawing(scene.snapshot(), window.renderer, **options)  # type: ignore[arg-type]
        return picture(window, view)


@pytest.mark.parametrize("offset", [HERE, FAR])
@pytest.mark.parametrize("name", town_views())
def test_both_modes_draw_the_same_picture(offset: Offset, name: str) -> None:
    scene, view = town(offset), town_views(offset)[name]
    merged = fresh(scene, view, mode="batches")
    assert np.array_equal(merged, fresh(scene, view, mode="actors"))
    assert len(np.unique(merged.reshape(-1, 3), axis=0)) > 1


def test_millimeters_survive_far_from_the_origin() -> None:
    # a gap of 2 mm between two slabs, seen from 1 m, 4000 km from the origin
    for offset in (HERE, FAR):
        slabs = [Mesh.box((-1, 0, 0.001), (1, 1, 1)), Mesh.box((-1, 0, -1), (1, 1, -0.001))]
        scene = Scene(Group(Transform(*[Geode(s, color=(1, 1, 1)) for s in slabs], translation=offset)))
        view = View(np.add(offset, (0, -1, 0)), offset, near=0.1, far=100, fov=1.0, width=100, height=100)
        column = fresh(scene, view)[:, 50].astype(int)
        rows = (column != column[0]).any(axis=1)
        # 2 mm are 11.5 of 100 pixels
        assert 10 <= np.count_nonzero(rows) <= 13


def test_a_town_far_away_looks_as_one_at_the_origin() -> None:
    for name in town_views():
        near, far = fresh(town(), town_views()[name]), fresh(town(FAR), town_views(FAR)[name])
        # rounding moves an edge here and there, by a pixel
        assert np.count_nonzero((near != far).any(axis=2)) <= 0.002 * near.shape[0] * near.shape[1]


def test_hiding_and_showing_again_leaves_no_trace(window: OffscreenWindow, rng: np.random.Generator) -> None:
    snapshot, view = town().snapshot(), town_views()["above"]
    for mode in ("batches", "actors"):
        drawing = Drawing(snapshot, window.renderer, mode=mode)
        whole = picture(window, view)
        for share in (0.0, 0.02, 0.5, 1.0):
            shown = rng.random(snapshot.n) < share
            drawing.show(shown)
            part = picture(window, view)
            assert np.array_equal(part, whole) == bool(shown.all())
            drawing.restore()
            assert np.array_equal(picture(window, view), whole)
        drawing.remove()
        assert len(np.unique(picture(window, view).reshape(-1, 3), axis=0)) == 1


def test_shown_rows_are_drawn_and_no_others(window: OffscreenWindow, rng: np.random.Generator) -> None:
    scene = town()
    snapshot, view = scene.snapshot(), town_views()["above"]
    drawing = Drawing(snapshot, window.renderer)
    shown = rng.random(snapshot.n) < 0.4
    drawing.show(shown)
    # the same by leaving the others out of the graph
    chosen = {id(snapshot.geodes[r]) for r in np.flatnonzero(shown)}
    for child in [n for n in scene.root.walk() if isinstance(n, Transform) and isinstance(n.children[0], Geode)]:
        if child.parent is not None and id(child.children[0]) not in chosen:
            child.parent.remove(child)
    with OffscreenWindow(view.width, view.height) as other:
        Drawing(scene.snapshot(), other.renderer)
        # another origin and another order of rows: not the same bits, but the same picture
        differ = (picture(window, view) != picture(other, view)).any(axis=2)
    assert np.count_nonzero(differ) <= 0.002 * differ.size


def test_mirrored_meshes_are_lit_like_their_originals() -> None:
    # mirrored twice, once by the mesh and once by the transform: the same body
    view = View((3, -4, 2), (0, 0, 0.5), near=0.1, far=100, width=120, height=90)
    for mesh in (BOX, ball(8, 8), ball(40, 40), ball(8, 8, smooth=False)):
        turned = Mesh(
            mesh.vertices * (-1, 1, 1),
            mesh.faces[:, ::-1],
            normals=None if mesh.normals is None else mesh.normals * np.float32([-1, 1, 1]),
        )
        plain = fresh(Scene(Group(Geode(mesh, color=(1, 1, 1)))), view)
        twice = fresh(Scene(Group(Transform(Geode(turned, color=(1, 1, 1)), scale=(-1, 1, 1)))), view)
        assert len(np.unique(plain.reshape(-1, 3), axis=0)) >= 4
        assert np.array_equal(plain, twice)


def test_texture_stands_upright(window: OffscreenWindow) -> None:
    snapshot = town(translucent=False).snapshot()
    drawing = Drawing(snapshot, window.renderer)
    drawing.show(np.array([g.name == "sign" for g in snapshot.geodes]))
    image = picture(window, View((0, -100, 22), (0, 0, 22), near=1, far=1000, width=480, height=270))
    background = image[0, 0]
    rows, columns = np.nonzero((image != background).any(axis=2))
    top, left = image[rows.min() + 3, (columns.min() + columns.max()) // 2], image[rows.max() - 3, columns.min() + 3]
    assert top[0] > 50
    assert top[1:].max() == 0
    assert left[1] > 50
    assert left[0] == left[2] == 0


def test_levels_and_standins(window: OffscreenWindow) -> None:
    parts = [Transform(Lod(ball(40, 40), BOX), translation=(3.0 * i, 0, 0)) for i in range(3)]
    snapshot = Scene(Group(*parts)).snapshot()
    view = View((3, -9, 1), (3, 0, 0), near=0.1, far=100, width=480, height=270)
    drawing = Drawing(snapshot, window.renderer)
    frame = Frame(snapshot, view)
    frame.coarsen([1], 1)
    frame.replace([2], BOX, Transform(translation=(6, 0, 0)).matrix)
    drawing.apply(frame)
    mixed = picture(window, view)
    boxes = [Geode(ball(40, 40)), Transform(Geode(BOX), translation=(3, 0, 0))]
    stand_in = Transform(Geode(BOX, color=(1, 1, 1)), translation=(6, 0, 0))
    with OffscreenWindow(480, 270) as other:
        Drawing(Scene(Group(*boxes, stand_in)).snapshot(), other.renderer)
        assert np.count_nonzero((mixed != picture(other, view)).any(axis=2)) <= 20
    drawing.apply(Frame(snapshot, view))
    whole = picture(window, view)
    drawing.apply(frame)
    assert np.array_equal(picture(window, view), mixed)
    assert not np.array_equal(whole, mixed)


def test_ties_of_depth_do_not_depend_on_what_else_is_drawn(window: OffscreenWindow, rng: np.random.Generator) -> None:
    # ten boxes at the same place: the last row wins, with or without the others
    group = Group(*[Geode(BOX, color=rng.random(3).tolist()) for _ in range(10)])
    group.add(*[Transform(Geode(BOX), translation=(2, i, 0)) for i in range(10)])
    snapshot = Scene(group).snapshot()
    drawing = Drawing(snapshot, window.renderer)
    view = View((0, -4, 2), (0, 0, 0.5), near=0.1, far=100, width=480, height=270)
    whole = picture(window, view)
    last = max(r for r in range(snapshot.n) if snapshot.boxes[0, r] == 0)
    for _ in range(5):
        shown = rng.random(snapshot.n) < 0.5
        shown[last] = True
        shown[snapshot.boxes[0] == 2] = True
        drawing.show(shown)
        assert np.array_equal(picture(window, view), whole)


@pytest.mark.parametrize("mode", ["batches", "actors"])
def test_sync_follows_moves_colors_and_structure(window: OffscreenWindow, mode: str) -> None:
    scene, view = town(), town_views()["above"]
    snapshot = scene.snapshot()
    drawing = Drawing(snapshot, window.renderer, mode=mode)  # type: ignore[arg-type]
    picture(window, view)
    parts = [n for n in scene.root.walk() if isinstance(n, Transform) and isinstance(n.children[0], Geode)]
    geometry = drawing.geometry
    for i, part in enumerate(parts[::5]):
        part.matrix = Transform(translation=(i, 0, 3)).matrix @ part.matrix
    snapshot.sync()
    drawing.sync()
    assert drawing.geometry is geometry
    moved = picture(window, view)
    # a new snapshot has another origin: not the same bits, but the same picture
    differ = np.abs(moved.astype(int) - fresh(scene, view, mode=mode)).max(axis=2)
    assert np.count_nonzero(differ > 8) <= 300
    scene.add(Switch(Transform(Geode(BOX, color=(1, 0, 1)), translation=(0, -100, 20), scale=30.0)))
    snapshot.sync()
    with pytest.raises(ValueError, match="sync"):
        drawing.show(np.ones(snapshot.n, bool))
    drawing.sync()
    assert drawing.geometry is not geometry
    assert np.array_equal(picture(window, view), fresh(scene, view, mode=mode))
    assert not np.array_equal(picture(window, view), moved)


@pytest.fixture
def culled_window() -> Iterator[OffscreenWindow]:
    with OffscreenWindow(480, 270, vtk_culler=True) as made:
        yield made


def test_vtk_culler_hides_what_is_outside_and_changes_no_pixel(culled_window: OffscreenWindow) -> None:
    scene, view = town(translucent=False), town_views()["street"]
    snapshot = scene.snapshot()
    drawing = Drawing(snapshot, culled_window.renderer, mode="actors")
    image = picture(culled_window, view)
    drawn = drawing.drawn_by_vtk()
    assert 0 < np.count_nonzero(drawn) < snapshot.n
    assert np.array_equal(image, fresh(scene, view))
    with OffscreenWindow(480, 270) as plain:
        assert plain.renderer.GetCullers().GetNumberOfItems() == 0
        merged = Drawing(snapshot, plain.renderer)
        with pytest.raises(ValueError, match="actors"):
            merged.drawn_by_vtk()


def test_clipping_range_is_the_views_own(window: OffscreenWindow) -> None:
    drawing = Drawing(town().snapshot(), window.renderer)
    view = town_views()["street"]
    drawing.show(np.zeros(drawing.snapshot.n, bool))
    window.draw(view)
    assert window.renderer.GetActiveCamera().GetClippingRange() == (view.near, view.far)


def test_empty_scene_and_smallest_window() -> None:
    with OffscreenWindow(1, 1) as window:
        drawing = Drawing(Scene().snapshot(), window.renderer)
        drawing.show(np.zeros(0, bool))
        assert picture(window, View((0, 0, 0), (0, 1, 0), width=1, height=1)).shape == (1, 1, 3)
        assert drawing.actor_count == 0
        assert drawing.memory == 0


def test_image_has_its_top_row_first(window: OffscreenWindow) -> None:
    snapshot = Scene(Group(Geode(BOX))).snapshot()
    Drawing(snapshot, window.renderer)
    image = picture(window, View((0, -4, 3), (0, 0, 3), near=0.1, far=100, width=480, height=270))
    rows = np.flatnonzero((image != image[0, 0]).any(axis=(1, 2)))
    assert rows.min() > 135
    depth = window.depth()
    assert np.flatnonzero((depth < 1).any(axis=1)).tolist() == rows.tolist()
