"""For plugin authors: tiny scenes, and the contract that every stage's test inherits.

Examples
--------
>>> class TestMyStage(StageContract):
...     stages = (MyStage(), MyStage(strength=2.0))
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, closing
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from .frame import Frame
from .mesh import Mesh
from .nodes import Geode, Group, Node, Transform
from .occluder import Occluder
from .pipeline import Pipeline
from .registry import Registry
from .scene import Scene
from .snapshot import Snapshot
from .stage import Guarantee, Stage
from .view import View

#: Scale and shift of the whole scene at which stages must keep working: micrometers to the solar system.
PLACES = ((1.0, 0.0), (1e-9, 0.0), (1e-6, 1e-3), (1.0, 1e7), (1e6, 0.0), (1e3, 1e11))


def box_at(center: ArrayLike, size: ArrayLike = 1.0, *, name: str = "", **options: Any) -> Geode:
    """A box drawable of edge lengths `size` around a point."""
    half = np.broadcast_to(np.asarray(size, float), (3,)) / 2
    middle = np.asarray(center, float)
    return Geode(Mesh.box(middle - half, middle + half, name=name), name=name, **options)


def wall_scene(scale: float = 1.0, offset: float = 0.0) -> Scene:
    """A thick wall with an occluder of each kind inside it, boxes before, behind and beside it.

    The eye of `wall_views` stands on the -y side. Boxes named "seen..." are visible from there, "behind..." are covered
    by the wall.
    """
    wall = Group(
        box_at((0, 0, 0), (8, 1, 6), name="wall"),
        Occluder.box((-4, -0.5, -3), (4, 0.5, 3), name="solid"),
        Occluder.planar([(-4, 0, -3), (4, 0, -3), (4, 0, 3), (-4, 0, 3)], name="planar"),
        name="wall group",
    )
    nodes: list[Node] = [wall]
    nodes += [box_at((x, -3, z), 0.4, name=f"seen before {x} {z}") for x in (-2, 0, 2) for z in (-1, 1)]
    nodes += [box_at((x, 4, z), 0.5, name=f"behind {x} {z}") for x in (-2, -1, 0, 1, 2) for z in (-1, 0, 1)]
    nodes += [box_at((x, 6, 0), 0.5, name=f"seen beside {x}") for x in (-15, 15)]
    nodes += [box_at((0, -60, 0), 1.0, name="out of view")]
    placed = Transform(*nodes, scale=scale, translation=(offset, offset, offset), name="place")
    return Scene(Group(placed, name="root"), name="wall")


def wall_views(scale: float = 1.0, offset: float = 0.0, **options: Any) -> list[View]:
    """Views of `wall_scene`, from the front and a little from the sides."""
    at = np.full(3, float(offset))
    options = {"width": 320, "height": 240, "near": 0.1 * scale, "far": 100.0 * scale, "fov": 75.0} | options
    eyes = ((0, -12, 0), (3, -12, 1), (-3, -14, -1))
    return [View(eye=at + scale * np.array(eye), target=at, **options) for eye in eyes]


def grid_scene(count: int = 6, *, spacing: float = 3.0) -> Scene:
    """count³ boxes in a regular grid around the origin, all sharing one mesh."""
    mesh = Mesh.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    axis = (np.arange(count) - (count - 1) / 2) * spacing
    places = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return Scene(Group(*(Transform(Geode(mesh), translation=p) for p in places), name="grid"), name="grid")


def random_views(rng: np.random.Generator, count: int, radius: float) -> list[View]:
    """Views from in and around a ball of this radius, each looking at some point of it, some orthographic."""
    views = []
    for number in range(count):
        eye = rng.uniform(-1.5, 1.5, 3) * radius
        target = eye + rng.standard_normal(3) * radius
        scale = radius / 2 if number % 4 == 3 else None
        fov = float(rng.uniform(20, 110))
        views.append(
            View(eye, target, fov=fov, width=160, height=120, near=0.01 * radius, far=6 * radius, parallel_scale=scale)
        )
    return views


def hostile_scene() -> Scene:
    """Drawables that break careless code: flat, empty, mirrored, singular, not a number, and one good sentinel."""
    nan = np.array(Mesh.box((0, 0, 0), (1, 1, 1)).vertices)
    nan[3, 1] = np.nan
    faces = Mesh.box((0, 0, 0), (1, 1, 1)).faces
    plain = Mesh.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    return Scene(
        Group(
            box_at((0, 0, 0), 1.0, name="sentinel"),
            Geode(Mesh(nan, faces), name="nan"),
            Geode(Mesh(np.zeros((0, 3)), np.zeros((0, 3))), name="empty"),
            Geode(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), name="flat"),
            Geode(Mesh([[2, 0, 0]] * 3, [[0, 1, 2]]), name="point"),
            Transform(Geode(plain, name="mirrored"), scale=(-1, 1, 1), translation=(3, 0, 0)),
            Transform(Geode(plain, name="singular"), scale=(0, 1, 1), translation=(-3, 0, 0)),
            Transform(Geode(plain, name="endless"), scale=(np.inf, 1, 1)),
            Transform(Geode(plain, name="kept", never_cull=True), translation=(0, 0, 500)),
            name="hostile",
        ),
        name="hostile",
    )


class HideRows(Stage):
    """Hides every k-th row: stands for whatever ran before the stage under test."""

    name = "hide_rows_for_tests"
    step = 3

    def run(self, frame: Frame) -> None:
        """Hide without looking."""
        frame.hide(np.arange(0, frame.snapshot.n, self.step))


def exact_visible_rows(snapshot: Snapshot, view: View, *, supersample: int = 1) -> NDArray[np.bool_]:
    """(n,) rows that the item buffer sees: the truth."""
    return next(iter(exact_visible_sets(snapshot, [view], supersample=supersample)))


def exact_visible_sets(snapshot: Snapshot, views: Sequence[View], *, supersample: int = 1) -> list[NDArray[np.bool_]]:
    """The truth of several views over one snapshot."""
    from .render.item_buffer import ItemBuffer

    with closing(ItemBuffer(snapshot)) as buffer:
        return [buffer.render(view, supersample=supersample).visible for view in views]


class StageContract:
    """What every stage must keep. Inherit, and set `stages`.

    Attributes
    ----------
    stages : sequence of Stage
        The stage under test in each setting that matters.
    before : sequence of Stage
        Stages that must run first, because the stage reads their products.
    preparations : Registry, optional
        Where its needs are looked up; the installed plugins by default.
    supersample : int
        Of the item buffer that conservative claims are held against.
    """

    stages: ClassVar[Sequence[Stage]] = ()
    before: ClassVar[Sequence[Stage]] = ()
    preparations: ClassVar[Registry | None] = None
    supersample: ClassVar[int] = 4

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Run every test for every stage in `stages`."""
        if "stage" in metafunc.fixturenames:
            metafunc.parametrize("stage", self.stages, ids=[s.text for s in self.stages])

    # -- running --------------------------------------------------------------------------------------------------

    def frames(self, stage: Stage, scene: Scene, views: Sequence[View], *, prior: Sequence[Stage] = ()) -> list[Frame]:
        """The frames of a pipeline that ends with the stage."""
        pipeline = Pipeline([*prior, *self.before, stage], preparations=self.preparations)
        with ExitStack() as stack:
            device = None
            if "gl" in pipeline.needs:
                from .render.device import Device
                from .render.window import OffscreenWindow

                window = stack.enter_context(OffscreenWindow(views[0].width, views[0].height))
                device = stack.enter_context(closing(Device(window)))
            with pipeline.open(scene.snapshot(), device=device):
                return [pipeline.run(view) for view in views]

    @staticmethod
    def claims_to_lose_nothing(stage: Stage) -> bool:
        """Whether the stage promises to hide nothing visible."""
        return stage.guarantee in (Guarantee.EXACT, Guarantee.CONSERVATIVE)

    # -- what is promised -----------------------------------------------------------------------------------------

    def test_is_declared_well(self, stage: Stage) -> None:
        """Name, summary, help of each parameter, and the text form that parses to the same stage."""
        assert stage.name.isidentifier()
        assert stage.name == stage.name.lower()
        assert stage.summary().endswith(".")
        assert all(p.help for p in stage.parameters().values()), "every parameter needs a help text"
        assert set(stage.writes) >= {w for w in stage.writes if isinstance(w, type)}
        if stage.guarantee is Guarantee.AGGRESSIVE:
            assert stage.bound, "an aggressive stage states its bound"
        known = Registry(discover=False)
        known.stages[stage.name] = type(stage)
        (again,) = Pipeline.parse(stage.text, known).stages if not (stage.reads or stage.needs) else (stage,)
        assert again.values() == stage.values()

    def test_empty_scene(self, stage: Stage) -> None:
        """No drawables: nothing happens."""
        (frame,) = self.frames(stage, Scene(), [View((0, -5, 0), (0, 0, 0))])
        assert frame.visible.shape == (0,)

    def test_one_drawable_in_front_of_the_eye_is_kept(self, stage: Stage) -> None:
        """The sentinel: a stage that hides everything must not pass."""
        (frame,) = self.frames(stage, Scene().add(box_at((0, 0, 0))), [View((0, -5, 0), (0, 0, 0))])
        assert frame.kept().tolist() == [True]

    def test_only_takes_away_what_it_declares(self, stage: Stage) -> None:
        """Result within the input, levels never finer, and nothing changed that is not declared."""
        frames = self.frames(stage, wall_scene(), wall_views(), prior=[HideRows()])
        for frame in frames:
            hidden_before = np.zeros(frame.snapshot.n, bool)
            hidden_before[:: HideRows.step] = True
            assert not frame.kept()[hidden_before].any()
            if "visible" not in stage.writes and "standins" not in stage.writes:
                assert np.array_equal(frame.visible, ~hidden_before)
            if "level" not in stage.writes:
                assert not frame.level.any()
            assert (frame.level < frame.snapshot.level_count).all()
            if "standins" not in stage.writes:
                assert not frame.standins

    def test_same_input_same_result(self, stage: Stage) -> None:
        """Two runs agree bit for bit."""
        views = wall_views()
        first = self.frames(stage, wall_scene(), views)
        second = self.frames(stage, wall_scene(), views)
        for a, b in zip(first, second, strict=True):
            assert np.array_equal(a.visible, b.visible)
            assert np.array_equal(a.level, b.level)
            assert len(a.standins) == len(b.standins)
            for mine, other in zip(a.standins, b.standins, strict=True):
                assert np.array_equal(mine.rows, other.rows)
                assert np.array_equal(mine.chosen, other.chosen)

    def test_protected_and_unknown_rows_are_kept(self, stage: Stage) -> None:
        """NEVER_CULL, NaN boxes and singular transforms survive; so does the sentinel, if the stage is conservative."""
        for view in (View((0, -8, 0.2), (0, 0, 0)), View((0, 8, 0.2), (0, 20, 0)), View((0, 0, 0.1), (0, 1, 0.1))):
            (frame,) = self.frames(stage, hostile_scene(), [view])
            kept = {g.name for g, v in zip(frame.snapshot.geodes, frame.kept(), strict=True) if v}
            assert {"nan", "empty", "endless", "kept"} <= kept
            if view.eye[1] == -8 and self.claims_to_lose_nothing(stage):
                assert "sentinel" in kept

    @pytest.mark.parametrize(("scale", "offset"), PLACES)
    def test_scale_and_shift_change_nothing(self, stage: Stage, scale: float, offset: float) -> None:
        """Coordinates from 1e-9 to 1e11: what was visible stays so, and nothing is newly lost."""
        plain = self.frames(stage, wall_scene(), wall_views())
        moved = self.frames(stage, wall_scene(scale, offset), wall_views(scale, offset))
        for a, b in zip(plain, moved, strict=True):
            names = [g.name for g in a.snapshot.geodes]
            assert names == [g.name for g in b.snapshot.geodes]
            lost = [name for name, was, now in zip(names, a.kept(), b.kept(), strict=True) if was and not now]
            assert not lost
            if self.claims_to_lose_nothing(stage):
                seen = [v for name, v in zip(names, b.kept(), strict=True) if name.startswith("seen before")]
                assert all(seen)

    @pytest.mark.parametrize(
        "options",
        [
            {"fov": 0.01},
            {"fov": 179.9},
            {"near": 1e-6, "far": 1e3},
            {"near": 1e-3, "far": 1e6},
            {"parallel_scale": 8.0},
            {"parallel_scale": 1e-3},
            {"width": 1, "height": 1},
            {"width": 7680, "height": 4320},
            {"width": 333, "height": 1},
            {"shift": (0.5, -0.25)},
        ],
        ids=str,
    )
    def test_extreme_views(self, stage: Stage, options: dict[str, Any]) -> None:
        """The box in the middle of every picture stays, if the stage is conservative; nothing raises anywhere."""
        scene = wall_scene().add(box_at((0, -11, 0), 0.5, name="in front"))
        for view in wall_views(**options)[:1]:
            (frame,) = self.frames(stage, scene, [view])
            kept = {g.name for g, v in zip(frame.snapshot.geodes, frame.kept(), strict=True) if v}
            if self.claims_to_lose_nothing(stage):
                assert "in front" in kept

    def test_eye_inside_and_on_things(self, stage: Stage) -> None:
        """Eye in the wall, on its face, on an edge, and a hair before it: a conservative stage keeps the wall."""
        for eye in ((0, 0, 0), (0, -0.5, 0), (4, -0.5, 3), (0, -0.5 - 1e-9, 0), (0, -0.5 + 1e-9, 0)):
            (frame,) = self.frames(stage, wall_scene(), [View(eye, (eye[0], 5, eye[2]), near=1e-6, far=100)])
            wall = [v for g, v in zip(frame.snapshot.geodes, frame.kept(), strict=True) if g.name == "wall"]
            if self.claims_to_lose_nothing(stage):
                assert wall == [True]

    @pytest.mark.gl
    def test_conservative_claims_hold_against_the_truth(self, stage: Stage) -> None:
        """No row that the item buffer sees is hidden by a stage that promises to lose nothing."""
        if not self.claims_to_lose_nothing(stage):
            pytest.skip(f"{stage.text} is {stage.guarantee.value}: its errors are measured, not forbidden")
        rng = np.random.default_rng(3)
        cases = [
            (wall_scene(), wall_views() + random_views(rng, 12, 12.0)),
            (grid_scene(5), random_views(rng, 12, 8.0)),
        ]
        for scene, views in cases:
            frames = self.frames(stage, scene, views)
            snapshot = frames[0].snapshot
            truths = exact_visible_sets(snapshot, views, supersample=self.supersample)
            for frame, view, truth in zip(frames, views, truths, strict=True):
                lost = truth & ~frame.kept()
                assert not lost.any(), f"hidden though visible: {snapshot.names(np.flatnonzero(lost))} from {view}"
