"""Levels for drawables that have none: made for a snapshot, not for the graph."""

from __future__ import annotations

import numpy as np
import pytest

import scenegraph as sg
from level_shapes import ball
from scenegraph.meshes import levels_for
from scenegraph.testing import box_at


class Coarsest(sg.Stage):
    """Draws everything at its last level."""

    name = "coarsest_for_tests"
    writes = ("level",)
    needs = ("levels",)

    def run(self, frame: sg.Frame) -> None:
        """Beyond the last is the last."""
        frame.coarsen(np.arange(frame.snapshot.n), 255)


VIEW = sg.View((0, -20, 0), (0, 0, 0))


def scene() -> sg.Scene:
    bumpy, plain = ball(8, 0.1, name="bumpy"), ball(6, name="plain")
    coarse = ball(2)
    return sg.Scene(
        sg.Group(
            sg.Transform(sg.Geode(bumpy, name="a"), translation=(-4, 0, 0), scale=2.0),
            sg.Transform(sg.Geode(bumpy, name="b"), translation=(4, 0, 0)),
            sg.Geode(plain, name="c"),
            sg.Transform(sg.Lod(plain, coarse, errors=(0, 0.5), name="own"), translation=(0, 0, 4)),
            box_at((0, 0, -4), name="box"),
        )
    )


def row(snapshot: sg.Snapshot, name: str) -> int:
    return next(i for i, g in enumerate(snapshot.geodes) if g.name == name)


def test_a_stage_that_needs_levels_gets_them():
    source = scene()
    snapshot = source.snapshot()
    boxes, keys, meshes = snapshot.boxes.copy(), snapshot.keys.copy(), list(snapshot.meshes)
    with sg.Pipeline([Coarsest()]).open(snapshot) as pipeline:
        frame = pipeline.run(VIEW)
    count = dict(zip([g.name for g in snapshot.geodes], snapshot.level_count.tolist(), strict=True))
    assert count == {"a": 7, "b": 7, "c": 7, "own": 2, "box": 1}
    assert frame.drawn_triangles() < 0.1 * frame.record.stages[0].triangles_before
    assert np.array_equal(snapshot.boxes, boxes), "a level lies in the box of its mesh"
    assert np.array_equal(snapshot.keys, keys)
    assert snapshot.meshes[: len(meshes)] == meshes, "numbers of meshes stay"
    assert all(isinstance(g, sg.Geode) for g in source.root.walk() if g.name in {"a", "b", "c"}), (
        "the graph is not touched"
    )


def test_errors_are_in_world_units():
    snapshot = scene().snapshot()
    snapshot.adopt_levels(levels_for(snapshot).chains)
    a, b = row(snapshot, "a"), row(snapshot, "b")
    errors = snapshot.errors
    assert (errors[1:, b] > 0).all()
    np.testing.assert_allclose(errors[:, a], 2 * errors[:, b], rtol=1e-6)
    assert (np.diff(errors[:, a]) >= 0).all()
    assert np.isnan(errors[2:, row(snapshot, "own")]).all()


def test_other_pipelines_over_the_snapshot_open_again():
    class Watches(Coarsest):
        name = "watches_for_tests"
        needs = ()
        opened = 0

        def open(self, snapshot, progress):
            self.opened += 1
            self.count = snapshot.level_count.copy()

    watcher = Watches()
    snapshot = scene().snapshot()
    with sg.Pipeline([watcher]).open(snapshot) as before:
        before.run(VIEW)
        with sg.Pipeline([Coarsest()]).open(snapshot) as pipeline:
            pipeline.run(VIEW)
            pipeline.run(VIEW)
            before.run(VIEW)
            before.run(VIEW)
    assert watcher.opened == 2
    assert watcher.count.max() == 7


def test_levels_survive_edits_and_new_drawables_get_theirs():
    source = scene()
    snapshot = source.snapshot()
    with sg.Pipeline([Coarsest()]).open(snapshot) as pipeline:
        pipeline.run(VIEW)
        source.root.add(sg.Transform(sg.Geode(ball(7, 0.2), name="new"), translation=(0, 0, 9)))
        snapshot.sync()
        assert snapshot.level_count[row(snapshot, "a")] == 7
        pipeline.run(VIEW)
        version = snapshot.structure_version
        pipeline.run(VIEW)
    assert snapshot.level_count[row(snapshot, "new")] > 1
    assert snapshot.structure_version == version


def test_adopting_the_same_twice_changes_nothing():
    snapshot = scene().snapshot()
    chains = levels_for(snapshot).chains
    snapshot.adopt_levels(chains)
    version = snapshot.version
    snapshot.adopt_levels(chains)
    snapshot.adopt_levels({})
    assert snapshot.version == version
    assert not levels_for(snapshot).chains, "nothing is left to do"


def test_a_level_that_sticks_out_grows_the_box():
    snapshot = scene().snapshot()
    mesh = next(m for m in snapshot.meshes if m.name == "plain")
    snapshot.adopt_levels({mesh: [(mesh, 0.0), (sg.Mesh.box((-3, -3, -3), (3, 3, 3)), 2.0)]})
    assert snapshot.boxes[3:, row(snapshot, "c")] == pytest.approx(3)
    assert snapshot.level_count[row(snapshot, "own")] == 2


def test_a_chain_of_another_mesh_is_refused():
    snapshot = scene().snapshot()
    mesh, other = snapshot.meshes[:2]
    with pytest.raises(sg.SceneError, match="begin with the mesh"):
        snapshot.adopt_levels({mesh: [(other, 0.0), (mesh, 1.0)]})


def test_limits_leave_the_less_promising_out():
    snapshot = scene().snapshot()
    made = levels_for(snapshot, max_meshes=1)
    assert [m.name for m in made.chains] == ["bumpy"], "most triangles are drawn of it"
    assert (len(made), made.too_small, made.left_out) == (1, 1, 1)
    assert levels_for(snapshot, max_triangles=10).left_out == 2


def test_hostile_scenes_do_no_harm():
    from scenegraph.testing import hostile_scene

    snapshot = hostile_scene().snapshot()
    boxes, unknown = snapshot.boxes.copy(), snapshot.unknown.copy()
    snapshot.adopt_levels(levels_for(snapshot, least_triangles=1).chains)
    np.testing.assert_array_equal(snapshot.boxes, boxes)
    assert snapshot.level_count[unknown].tolist() == [1, 1, 2], "only the endless one has a sound mesh"
    assert not levels_for(sg.Scene().snapshot()).chains


def test_progress_rises_to_one():
    shares = []
    levels_for(scene(), progress=lambda what, share: shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1)


@pytest.mark.gl
def test_a_drawing_that_is_older_than_the_levels_shows_them():
    from scenegraph.render.drawing import Drawing
    from scenegraph.render.window import OffscreenWindow

    snapshot = scene().snapshot()
    with OffscreenWindow(160, 120) as window:
        drawing = Drawing(snapshot, window.renderer)
        window.draw(VIEW)
        fine = window.image()
        with sg.Pipeline([Coarsest()]).open(snapshot) as pipeline:
            frame = pipeline.run(VIEW)
        drawing.apply(frame)
        window.draw(VIEW)
        coarse = window.image()
    changed = (fine != coarse).any(axis=2).sum()
    assert 0 < changed < 0.2 * fine.shape[0] * fine.shape[1]
