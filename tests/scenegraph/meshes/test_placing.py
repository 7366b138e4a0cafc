"""Occluders placed in a scene: which meshes first, and whose they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import scenegraph as sg
from mesh_proofs import torus
from scenegraph import Mesh, SceneError
from scenegraph.meshes import SceneOccluders, occluders_for

CUBE = Mesh.box((0, 0, 0), (1, 1, 1), name="cube")
SMALL = Mesh.box((0, 0, 0), (0.1, 0.1, 0.1), name="small")
FAST: dict[str, Any] = {"cells": 12, "cache": None}


def test_meshes_are_taken_by_size_times_count() -> None:
    scene = sg.Scene(
        sg.Group(
            *(sg.Transform(sg.Geode(SMALL), translation=(i, 3, 0)) for i in range(5)),
            sg.Transform(sg.Geode(CUBE), translation=(0, 0, 5)),
            *(sg.Transform(sg.Geode(Mesh.box((0, 0, 0), (2, 2, 2), name="big")), translation=(9, 9, 9)),),
        )
    )
    found = occluders_for(scene, least_size=0.0, **FAST)
    assert [m.mesh.name for m in found.meshes] == ["big", "cube", "small"]
    assert [m.drawables for m in found.meshes] == [1, 1, 5]
    assert found.meshes[0].area == pytest.approx(6)
    assert (len(found), found.meshes_left) == (7, 0)
    assert len(occluders_for(scene, least_size=0.05, **FAST).meshes) == 2  # the smallest do not count
    best = occluders_for(scene, least_size=0.0, max_nodes=2, **FAST)
    assert [p.node.mesh.name for p in best.placed if isinstance(p.node, sg.Geode)] == ["big", "cube"]
    assert best.meshes[2].notes == ["some left out, as others cover more (5; 2 are kept in all)"]


def test_beyond_the_most_meshes_only_convex_ones_count() -> None:
    ring = torus(1.0, 0.3)
    scene = sg.Scene(
        sg.Group(sg.Geode(Mesh.box((0, 0, 0), (9, 9, 9), name="big")), sg.Geode(ring), sg.Geode(CUBE, name="cube"))
    )
    few = occluders_for(scene, max_meshes=1, **FAST)
    assert [m.mesh.name for m in few.meshes] == ["big", "cube"]
    assert few.meshes_left == 1
    assert len(occluders_for(scene, max_meshes=3, **FAST).meshes) == 3


def test_occluders_follow_their_drawable_and_never_hide_it() -> None:
    geode = sg.Geode(CUBE, name="house")
    place = sg.Transform(geode, translation=(10, 0, 0), name="place")
    crumb = Mesh.box((0, 0, 0), (1e-3, 1e-3, 1e-3))
    scene = sg.Scene(sg.Group(place, sg.Geode(crumb)))
    snapshot = scene.snapshot()
    found = occluders_for(snapshot, **FAST)
    assert len(snapshot.occluders) == 0
    found.attach()
    snapshot.sync()
    (occluder,) = (n for n in place if isinstance(n, sg.Occluder))
    assert occluder.name == "house: box 1"
    assert tuple(snapshot.occluders.owner[0]) == snapshot.rows_of(geode)
    low, high = snapshot.occluders.vertices.min(axis=0), snapshot.occluders.vertices.max(axis=0)
    assert np.allclose((low, high), ((10, 0, 0), (11, 1, 1)), atol=1e-4)
    assert (low > (10, 0, 0)).all()
    place.matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    snapshot.sync()
    assert np.allclose(snapshot.occluders.vertices.max(axis=0), 2, atol=1e-4)
    found.detach()
    snapshot.sync()
    assert len(snapshot.occluders) == 0
    found.attach()
    scene.root.remove(place)
    place.remove(geode)
    with pytest.raises(SceneError, match="no longer in the graph"):
        found.attach()


def test_below_a_switch_the_numbers_of_the_children_stay() -> None:
    first, second = sg.Geode(CUBE, name="first"), sg.Geode(SMALL, name="second")
    switch = sg.Switch(first, second, active={0})
    scene = sg.Scene(sg.Group(switch, sg.Transform(sg.Geode(SMALL, name="third"), translation=(3, 3, 3))))
    found = occluders_for(scene, **FAST)
    found.attach()
    assert len(switch) == 2
    assert switch.active == {0}
    assert first in switch.children[0].walk()
    snapshot = scene.snapshot()
    assert len(snapshot.occluders) == 2
    switch.active = {1}
    snapshot.sync()
    assert [o.name for o in snapshot.occluders.nodes] == ["third: box 1"]


def test_rows_that_cannot_hide_anything_are_left_out() -> None:
    broken = Mesh(np.vstack([CUBE.vertices[:-1], [[np.nan] * 3]]), CUBE.faces)
    scene = sg.Scene(
        sg.Group(
            sg.Geode(CUBE, color=(1, 1, 1, 0.5), name="glass"),
            sg.Geode(broken, name="broken"),
            sg.Transform(sg.Geode(CUBE, name="flat"), scale=(1, 1, 0)),
            sg.Geode(Mesh(CUBE.vertices, CUBE.faces, color=(0, 0, 0, 0.9)), name="smoke"),
            sg.Geode(Mesh.box((0, 0, 0), (1e-4, 1e-4, 1e-4)), name="crumb"),
            sg.Transform(sg.Geode(CUBE, name="solid", color=(1, 0, 0)), translation=(3, 0, 0)),
        )
    )
    found = occluders_for(scene, **FAST)
    assert [p.node.name for p in found.placed] == ["solid"]
    assert occluders_for(sg.Scene(), **FAST).placed == []
    assert occluders_for(sg.Scene(sg.Group(sg.Geode(broken))), **FAST).meshes == []


@pytest.mark.parametrize("matrix", [np.diag([-1.0, 2.0, 1.0, 1.0]), np.diag([1e-6, 1e-6, 1e-6, 1.0])])
def test_mirrored_and_small_ones_take_part(matrix: np.ndarray) -> None:  # type: ignore[type-arg]
    scene = sg.Scene(sg.Group(sg.Transform(sg.Geode(CUBE), matrix=matrix)))
    found = occluders_for(scene, **FAST)
    found.attach()
    snapshot = scene.snapshot()
    low, high = snapshot.boxes[:3, 0] - snapshot.boxes[3:, 0], snapshot.boxes[:3, 0] + snapshot.boxes[3:, 0]
    assert (snapshot.occluders.vertices > low).all()
    assert (snapshot.occluders.vertices < high).all()


def test_levels_are_fitted_by_the_finest() -> None:
    lod = sg.Lod(CUBE, SMALL, errors=(0, 1), name="lod")
    found = occluders_for(sg.Scene(sg.Group(lod)), **FAST)
    assert [(p.node, len(p.occluders)) for p in found.placed] == [(lod, 1)]


def room(*inside: sg.Node, mesh: Mesh = CUBE) -> SceneOccluders:
    scene = sg.Scene(sg.Group(sg.Transform(sg.Geode(mesh, name="room"), scale=10), *inside))
    return occluders_for(scene, least_size=0.0, openings="outward", **FAST)


def owners(found: SceneOccluders) -> set[str]:
    return {p.node.name for p in found.placed for o in p.occluders if o.kind == "solid"}


def test_what_holds_other_drawables_is_a_room_and_no_solid() -> None:
    chair = sg.Transform(sg.Geode(SMALL, name="chair"), translation=(5, 5, 5))
    found = room(chair)
    assert owners(found) == {"chair"}
    assert found.meshes[0].notes == ["no solids: other drawables are inside (/Group/Transform/room)"]
    sky = Mesh(CUBE.vertices, CUBE.faces[:, ::-1])
    assert owners(room(sg.Transform(sg.Geode(SMALL, name="chair"), translation=(5, 5, 5)), mesh=sky)) == {"chair"}


def test_what_lies_beside_or_sticks_in_the_wall_does_not_matter() -> None:
    beside = sg.Transform(sg.Geode(SMALL, name="beside"), translation=(12, 5, 5))
    balcony = sg.Transform(sg.Geode(CUBE, name="balcony"), translation=(9.5, 5, 5))
    assert owners(room(beside, balcony)) == {"room", "beside", "balcony"}


def test_in_a_thing_with_covered_openings_nothing_may_stick() -> None:
    p = CUBE.vertices[CUBE.faces]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    shed = Mesh(CUBE.vertices, CUBE.faces[normal[:, 2] > -0.5], name="shed")
    ground = sg.Transform(sg.Geode(Mesh.box((-1, -1, -1), (2, 2, 0), name="ground")), scale=10)
    assert "room" in owners(room(ground, mesh=shed))
    balcony = sg.Transform(sg.Geode(CUBE, name="balcony"), translation=(8.5, 5, 5))
    assert "room" not in owners(room(balcony, mesh=shed))


def test_progress_runs_from_0_to_1() -> None:
    told: list[float] = []
    scene = sg.Scene(sg.Group(sg.Geode(CUBE), sg.Transform(sg.Geode(SMALL), translation=(2, 0, 0))))
    occluders_for(scene, least_size=0.0, progress=lambda what, share: told.append(share), **FAST)
    assert told == sorted(told)
    assert told[-1] == 1.0


def view(eye: tuple[float, float, float], **options: Any) -> sg.View:
    return sg.View(eye, (0.5, 0.5, 0.5), near=0.01, **options)


def test_fitted_solids_say_nothing_to_eyes_within_their_drawable() -> None:
    scene = sg.Scene(sg.Group(sg.Geode(CUBE), sg.Occluder.box((0.1, 0.1, 0.1), (0.2, 0.2, 0.2))))
    occluders_for(scene, **FAST).attach()
    snapshot = scene.snapshot()
    fitted = [o.outside_only for o in snapshot.occluders.nodes]
    assert sorted(fitted) == [False, True]

    def holds(v: sg.View) -> bool:
        found = snapshot.occluders.holds_for(v, snapshot.boxes)
        assert found[fitted.index(False)]
        return bool(found[fitted.index(True)])

    assert holds(view((3, 0.4, 0.4)))
    assert not holds(view((0.9, 0.4, 0.4)))
    assert not holds(view((1.005, 0.5, 0.5)))  # the near plane cuts into the cube
    assert holds(view((1.02, 0.5, 0.5)))
    assert holds(view((3, 0.4, 0.4), parallel_scale=1.0))
    # without perspective, rays start all over the near plane
    assert not holds(sg.View((0.5, 3, 0.5), (0.4, 3, 0.5), near=0.01, parallel_scale=5.0))


def test_an_occluder_whose_drawable_is_gone_is_not_used() -> None:
    geode = sg.Geode(CUBE)
    scene = sg.Scene(sg.Group(sg.Group(geode, name="g"), sg.Geode(SMALL)))
    occluders_for(scene, **FAST).attach()
    geode.parent.remove(geode)  # type: ignore[union-attr]
    snapshot = scene.snapshot()
    away = [o.owner is geode for o in snapshot.occluders.nodes]
    found = snapshot.occluders.holds_for(view((3, 0.4, 0.4)), snapshot.boxes)
    assert not found[away].any()
