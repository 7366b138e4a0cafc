"""The stage `hom`: what it promises, what it hides, and what it hands on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import scenegraph as sg
import scenegraph_hom
from scenegraph.testing import StageContract, box_at, grid_scene, random_views, wall_scene, wall_views
from scenegraph_hom import Hom, OcclusionMap

KNOWN = sg.Registry(discover=False)
KNOWN.add(scenegraph_hom)


class TestHom(StageContract):
    stages = (
        Hom(least=1),
        Hom(least=1, occluders="meshes", ranking="visible", outlines=False),
        Hom(least=1, occluders="declared", ranking="distance", reach=1e12),
        Hom(least=1, test="pyramid", width=333, height=77),
        Hom(least=1, width=1, height=1),
        Hom(least=1, active=1, triangles=12),
        Hom(least=1, opacity=0.9),
        Hom(least=1, strict=False),
        Hom(least=1, depth="distance", ranking="distance", strict=False, test="pyramid"),
    )


@pytest.mark.gl
class TestHomByOpenGL(StageContract):
    stages = (Hom(least=1, producer="gl"), Hom(least=1, producer="gl", strict=False, test="pyramid"))


def run(scene: sg.Scene | sg.Snapshot, view: sg.View, **values: Any) -> sg.Frame:
    snapshot = scene.snapshot() if isinstance(scene, sg.Scene) else scene
    with sg.Pipeline([Hom(least=1, **values)]).open(snapshot) as pipeline:
        return pipeline.run(view)


def hidden(frame: sg.Frame) -> set[str]:
    return {g.name for g, v in zip(frame.snapshot.geodes, frame.visible, strict=True) if not v}


def names(scene: sg.Scene, start: str) -> set[str]:
    return {g.name for g in scene.snapshot().geodes if g.name.startswith(start)}


# Promises


@pytest.mark.parametrize(
    ("values", "promise"),
    [
        ({}, "conservative"),
        ({"test": "pyramid"}, "conservative"),
        ({"ranking": "distance", "occluders": "meshes", "width": 7, "outlines": False}, "conservative"),
        ({"opacity": 0.99}, "aggressive"),
        ({"opacity": 0.99, "test": "pyramid"}, "approximate"),
        ({"strict": False}, "approximate"),
        ({"depth": "distance"}, "approximate"),
        ({"coarsest": True}, "approximate"),
        ({"producer": "gl"}, "approximate"),
    ],
)
def test_guarantee_depends_on_the_parameters(values: dict[str, Any], promise: str) -> None:
    assert Hom(**values).guarantee.value == promise


def test_only_opengl_needs_opengl() -> None:
    assert Hom().needs == ()
    assert Hom.needs == ()
    assert Hom(producer="gl").needs == ("gl",)
    with pytest.raises(sg.PipelineError, match="needs OpenGL"):
        sg.Pipeline([Hom(producer="gl")]).open(wall_scene().snapshot())
    with pytest.raises(sg.PipelineError, match="use occluders='meshes'"):
        Hom(producer="gl", occluders="declared")


def test_text_of_a_pipeline() -> None:
    text = "hom(width=256, opacity=0.98, depth='distance')"
    assert sg.Pipeline.parse(text, KNOWN).text == text
    with pytest.raises(sg.PipelineError, match=r"opacity=1\.5 is above its maximum 1"):
        sg.Pipeline.parse("hom(opacity=1.5)", KNOWN)


# What is hidden


@pytest.mark.parametrize("occluders", ["auto", "declared", "meshes"])
@pytest.mark.parametrize("test", ["exact", "pyramid"])
@pytest.mark.parametrize("ranking", ["size", "distance", "visible"])
def test_hides_what_the_wall_covers(occluders: str, test: str, ranking: str) -> None:
    scene = wall_scene()
    for view in wall_views():
        frame = run(scene, view, occluders=occluders, test=test, descents=9, ranking=ranking)
        assert hidden(frame) == names(scene, "behind")


@pytest.mark.parametrize("options", [{"parallel_scale": 8.0}, {"shift": (0.2, -0.1)}, {"width": 1000, "height": 300}])
def test_hides_in_other_projections(options: dict[str, Any]) -> None:
    scene = wall_scene()
    assert hidden(run(scene, wall_views(**options)[0])) == names(scene, "behind")


def test_a_planar_occluder_hides_and_its_holes_do_not() -> None:
    square = np.array([(-4, 0, -4), (4, 0, -4), (4, 0, 4), (-4, 0, 4)], float)
    view = sg.View((0, -10, 0), (0, 0, 0))
    behind = [box_at((x, 3, 0), 0.5, name=f"at {x}") for x in (-2, 0, 2)]
    for order in (1, -1):
        hole = 0.15 * square[::order]
        scene = sg.Scene().add(*behind, sg.Occluder.planar(square, holes=[hole]))
        assert hidden(run(scene, view)) == {"at -2", "at 2"}
        assert hidden(run(scene, sg.View((0, 10, 0), (0, 0, 0)))) == set()
        for node in (*behind, *scene.root.children):
            if node.parent is not None:
                scene.root.remove(node)


def test_a_one_sided_occluder_hides_from_its_front_only() -> None:
    square = np.array([(-4, 0, -4), (4, 0, -4), (4, 0, 4), (-4, 0, 4)], float)
    sides = {}
    for two_sided in (True, False):
        for eye, other in (((0, -9, 0), 4), ((0, 9, 0), -4)):
            for scale in (None, 5.0):
                thing = box_at((0, other, 0), name="thing")
                scene = sg.Scene().add(thing, sg.Occluder.planar(square, two_sided=two_sided))
                frame = run(scene, sg.View(eye, (0, 0, 0), parallel_scale=scale))
                sides[two_sided, other, scale] = hidden(frame) == {"thing"}
    assert all(value == (two_sided or other > 0) for (two_sided, other, _), value in sides.items())


def test_mirrored_inverted_and_open_meshes_occlude_as_well() -> None:
    box = sg.Mesh.box((-3, -1, -3), (3, 1, 3))
    inverted = sg.Mesh(box.vertices, box.faces[:, ::-1])
    lid_off = sg.Mesh(box.vertices, np.delete(box.faces, [0, 1], axis=0))
    apart = sg.Mesh(box.vertices[box.faces].reshape(-1, 3), np.arange(36).reshape(12, 3))
    shell = sg.Mesh(
        np.concatenate([box.vertices, 0.9 * box.vertices]), np.concatenate([box.faces, box.faces[:, ::-1] + 8])
    )
    target = box_at((0, 4, 0), name="target")
    views = [
        sg.View((0.3, -12, 0.4), (0, 0, 0)),
        sg.View((4, -12, 3), (0, 0, 0)),
        sg.View((4, -12, 3), (0, 0, 0), parallel_scale=6),
    ]
    for mesh in (box, inverted, lid_off, apart, shell):
        for scale in ((1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, -1)):
            wall = sg.Transform(sg.Geode(mesh, name="wall"), scale=scale)
            scene = sg.Scene().add(target, wall)
            for view in views:
                assert hidden(run(scene, view)) == {"target"}
            scene.root.remove(target)


def test_an_open_box_seen_from_its_open_side_is_as_deep_as_its_back() -> None:
    """What is inside it can be seen; what is behind it cannot."""
    box = sg.Mesh.box((-3, -3, -3), (3, 3, 3))
    middle = box.vertices[box.faces].mean(axis=1)
    open_front = sg.Mesh(box.vertices, box.faces[middle[:, 1] > -3 + 1e-9])
    assert open_front.triangles == 10
    scene = sg.Scene().add(sg.Geode(open_front, name="cupboard"))
    scene.add(box_at((0, 1, 0), name="inside"), box_at((0, 6, 0), name="behind"))
    assert hidden(run(scene, sg.View((0, -12, 0), (0, 0, 0)))) == {"behind"}


def test_a_room_hides_what_is_beyond_its_walls() -> None:
    """Seen from inside, whatever way its faces are wound; its farthest corner decides."""
    room = sg.Mesh.box((-3, -3, -3), (3, 3, 3))
    for faces in (room.faces, room.faces[:, ::-1]):
        scene = sg.Scene().add(sg.Geode(sg.Mesh(room.vertices, faces), name="room"))
        scene.add(box_at((0, 1, 0), 0.5, name="inside"), box_at((0, 9, 0), name="beyond"))
        for scale in (None, 1.0):
            assert hidden(run(scene, sg.View((0, -2, 0), (0, 0, 0), parallel_scale=scale))) == {"beyond"}


def test_a_declared_occluder_around_the_eye_hides_nothing() -> None:
    scene = sg.Scene().add(sg.Occluder.box((-3, -3, -3), (3, 3, 3)), box_at((0, 9, 0), name="beyond"))
    for scale in (None, 1.0):
        view = sg.View((0, -2, 0), (0, 0, 0), parallel_scale=scale)
        assert hidden(run(scene, view, occluders="declared")) == set()


def test_a_wall_beside_the_eye_is_cut_at_the_near_plane() -> None:
    """The wall begins behind the eye and ends far ahead: the occluder that matters most in a street."""
    scene = sg.Scene().add(box_at((2, 40, 0), (2, 100, 8), name="wall"))
    scene.add(*(box_at((6, y, 0), name=f"behind {y}") for y in (5, 10, 20, 40)))
    scene.add(*(box_at((-3, y, 0), name=f"before {y}") for y in (10, 40)))
    for scale in (None, 12.0):
        view = sg.View((0, 0, 0), (1, 10, 0), near=0.1 if scale is None else -200.0, parallel_scale=scale)
        assert hidden(run(scene, view)) == (names(scene, "behind") if scale is None else hidden(run(scene, view)))
    assert hidden(run(scene, sg.View((0, 0, 0), (1, 10, 0)))) == names(scene, "behind")


def test_what_stands_before_the_near_plane_does_not_occlude() -> None:
    scene = sg.Scene().add(box_at((0, 2, 0), (4, 0.5, 4), name="wall"), box_at((0, 9, 0), name="behind"))
    assert hidden(run(scene, sg.View((0, 0, 0), (0, 1, 0), near=0.1))) == {"behind"}
    assert hidden(run(scene, sg.View((0, 0, 0), (0, 1, 0), near=3.0))) == set()


def test_things_side_by_side_hide_together() -> None:
    """Fusion, which no single occluder achieves."""
    scene = sg.Scene().add(box_at((0, 8, 0), 2.0, name="behind"))
    scene.add(*(box_at((x, y, 0), (1.5, 1, 6), name="post") for x, y in ((-0.7, 0), (0.7, 0.5))))
    assert hidden(run(scene, sg.View((0, -12, 0), (0, 0, 0)))) == {"behind"}
    assert hidden(run(scene, sg.View((0, -12, 0), (0, 0, 0)), active=1)) == set()


def test_translucent_things_do_not_occlude() -> None:
    view = sg.View((0, -12, 0), (0, 0, 0))
    box = sg.Mesh.box((-3, -1, -3), (3, 1, 3))
    clear = np.full((8, 4), 255, np.uint8)
    clear[3, 3] = 254
    glass = sg.Mesh(box.vertices, box.faces, vertex_colors=clear)
    fence = sg.Mesh(box.vertices, box.faces, uv=np.zeros((8, 2)), texture=np.zeros((2, 2, 4), np.uint8))
    for wall in (sg.Geode(box, color=(1, 1, 1, 0.99)), sg.Geode(glass), sg.Geode(fence)):
        assert hidden(run(sg.Scene().add(wall, box_at((0, 4, 0), name="target")), view)) == set()
    assert hidden(run(sg.Scene().add(sg.Geode(box), box_at((0, 4, 0), name="target")), view)) == {"target"}


def test_depth_is_compared_and_the_shortcut_is_not() -> None:
    """'No object can be closer to the viewpoint than the occluders' is false for a ground plane (errata)."""
    ground = box_at((0, 50, -1), (100, 200, 0.1), name="ground")
    scene = sg.Scene().add(ground, *(box_at((x, 30, -0.5), 0.4, name="on it") for x in range(-5, 6)))
    view = sg.View((0, 0, 4), (0, 30, 0))
    near_first = {"ranking": "distance", "reach": 10.0}
    assert hidden(run(scene, view, **near_first)) == set()
    assert hidden(run(scene, view, depth="distance", **near_first)) == {"on it"}


def test_occluders_hide_each_other_but_not_in_the_thesis_way() -> None:
    scene = sg.Scene().add(*(box_at((0, y, 0), 2.0 + 0.01 * y, name=f"box {y}") for y in (0, 5, 10)))
    view = sg.View((0, -12, 0), (0, 0, 0))
    assert hidden(run(scene, view)) == {"box 5", "box 10"}
    assert hidden(run(scene, view, depth="distance")) == set()


def test_equal_things_in_one_place_do_not_hide_each_other() -> None:
    scene = sg.Scene().add(*(box_at((0, 0, 0), 2.0, name=str(i)) for i in range(3)))
    for eye in ((0, -5, 0), (3, -5, 2)):
        for scale in (None, 2.0):
            assert hidden(run(scene, sg.View(eye, (0, 0, 0), parallel_scale=scale))) == set()


def test_opacity_is_a_budget_of_texels() -> None:
    """A gap of a known number of columns in an orthographic view, one texel wide each."""
    scene = sg.Scene()
    scene.add(box_at((-5.2, 0, 0), (10, 1, 9), name="left"), box_at((5.2, 0, 0), (10, 1, 9), name="right"))
    scene.add(box_at((0, 5, 0), (8, 1, 4), name="behind"))
    view = sg.View((0, -20, 0), (0, 0, 0), parallel_scale=8, width=512, height=256)
    frame = run(scene, view, opacity=0.5)
    assert hidden(frame) == {"behind"}
    occlusion = frame.get(OcclusionMap)
    row = [g.name for g in frame.snapshot.geodes].index("behind")
    texels, codes, _ = occlusion.footprint(frame.snapshot.boxes[:, [row]])
    x0, y0, x1, y1 = texels[:, 0]
    # it covers the gap itself, but not in front of itself
    open_share = 1 - (occlusion.codes[y0:y1, x0:x1] > codes[0]).mean()
    assert 0 < open_share < 0.5
    assert hidden(run(scene, view, opacity=1 - open_share)) == {"behind"}
    assert hidden(run(scene, view, opacity=1 - open_share + 1e-6)) == set()
    assert hidden(run(scene, view)) == set()


def test_centers_miss_a_gap_that_strict_coverage_keeps_open() -> None:
    scene = sg.Scene()
    scene.add(box_at((-5.001, 0, 0), (10, 1, 9), name="left"), box_at((5.001, 0, 0), (10, 1, 9), name="right"))
    scene.add(box_at((0, 5, 0), (8, 1, 4), name="behind"))
    view = sg.View((0, -20, 0), (0, 0, 0), parallel_scale=8)
    assert hidden(run(scene, view, strict=False)) == {"behind"}
    assert hidden(run(scene, view)) == set()


def test_outlines_see_past_the_corners_of_a_rectangle() -> None:
    """A long box, turned: its rectangle is mostly empty."""
    beam = sg.Transform(box_at((0, 0, 0), (8, 0.3, 0.3), name="beam"), rotation=(45, (0, 1, 0)), translation=(0, 6, 0))
    board = sg.Transform(box_at((0, 0, 0), (12, 0.3, 1.5), name="board"), rotation=(45, (0, 1, 0)))
    scene = sg.Scene().add(beam, board)
    view = sg.View((0, -20, 0), (0, 0, 0))
    assert hidden(run(scene, view)) == {"beam"}
    assert hidden(run(scene, view, outlines=False)) == set()


# Skipping


def test_skips_when_few_candidates_are_left_or_nothing_can_occlude() -> None:
    with sg.Pipeline([Hom()]).open(wall_scene().snapshot()) as pipeline:
        assert pipeline.run(wall_views()[0]).record.stages[0].skipped == "only 25 candidates left"
    with sg.Pipeline([Hom(least=1)]).open(
        sg.Scene().add(box_at((0, 0, 0), color=(1, 1, 1, 0.5))).snapshot()
    ) as pipeline:
        frame = pipeline.run(sg.View((0, -5, 0), (0, 0, 0)))
        assert frame.record.stages[0].skipped == "nothing in the scene can be an occluder"
        assert frame.find(OcclusionMap) is None


# Hierarchy, edits


def test_hierarchical_hides_no_less_than_flat(monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot = grid_scene(9, spacing=1.7).snapshot()
    for view in random_views(np.random.default_rng(2), 8, 9.0):
        flat = run(snapshot, view, outlines=False)
        monkeypatch.setattr("scenegraph.traversal.FLAT_LIMIT", 0)
        walked = run(snapshot, view, outlines=False)
        monkeypatch.undo()
        assert not (walked.visible & ~flat.visible).any()
        # a node that is hidden as far as it is in the view takes along what is not in the view
        more = flat.visible & ~walked.visible
        assert not flat.get(OcclusionMap).footprint(snapshot.boxes[:, more]).testable.any()


def test_follows_moves_and_edits() -> None:
    wall = sg.Transform(box_at((0, 0, 0), (6, 1, 6), name="wall"), sg.Occluder.box((-3, -0.5, -3), (3, 0.5, 3)))
    scene = sg.Scene().add(wall, box_at((0, 4, 0), name="target"))
    snapshot = scene.snapshot()
    view = sg.View((0, -12, 0), (0, 0, 0))
    with sg.Pipeline([Hom(least=1)]).open(snapshot) as pipeline:
        assert hidden(pipeline.run(view)) == {"target"}
        wall.matrix = np.array([[1, 0, 0, 20], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        snapshot.sync()
        assert hidden(pipeline.run(view)) == set()
        scene.add(box_at((0, -2, 0), 4.0, name="new wall"))
        snapshot.sync()
        assert hidden(pipeline.run(view)) == {"target"}


# OpenGL, and the door


def test_the_plugin_registers_its_stage() -> None:
    known = sg.Registry(discover=False)
    known.add(scenegraph_hom)
    assert known.failures == []
    assert known.stages == {"hom": Hom}


@pytest.mark.gl
def test_opengl_draws_the_same_map_but_for_its_borders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Centers by two rasterizers: they differ where an edge passes a center by less than a snapped corner."""
    from contextlib import closing

    from scenegraph.render.device import Device
    from scenegraph.render.window import OffscreenWindow

    monkeypatch.setattr("scenegraph_hom.scan.DEPTH_STEP", 1e-6)
    monkeypatch.setattr("scenegraph_hom.scan.PARALLEL_STEP", 1e-6)
    rng = np.random.default_rng(4)
    scene = sg.Scene()
    for place in rng.uniform(-6, 6, (40, 3)):
        turn = (float(rng.uniform(0, 360)), rng.standard_normal(3))
        scene.add(
            sg.Transform(box_at((0, 0, 0), rng.uniform(0.5, 3, 3)), rotation=turn, translation=place + [0, 20, 0])
        )
    snapshot = scene.snapshot()
    with OffscreenWindow(64, 64) as window, closing(Device(window)) as device:
        for options in ({}, {"parallel_scale": 7.0}):
            view = sg.View((0, 0, 0), (0, 1, 0), near=1.0, far=100.0, **options)
            for strict in (False, True):
                maps = []
                for producer in ("numpy", "gl"):
                    stage = Hom(least=1, producer=producer, strict=strict, occluders="meshes")
                    with sg.Pipeline([stage]).open(snapshot, device=device) as pipeline:
                        maps.append(pipeline.run(view).get(OcclusionMap))
                ours, theirs = maps
                assert ours.covered.sum() > 10_000
                differ = ours.covered != theirs.covered
                if strict:
                    # nine centers are asked for, and every shape loses its own border: neither holds the other
                    assert differ.mean() < 0.1
                    continue
                assert differ.mean() < 0.002
                near, far = ours.depth(), theirs.depth()
                both = np.isfinite(near) & np.isfinite(far)
                # ours is the depth of the farthest point in the texel, theirs that of its center
                assert (near[both] >= far[both] * (1 - 1e-3)).mean() > 0.99
                assert np.median(near[both] / far[both]) < 1.005
