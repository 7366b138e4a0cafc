"""Scans, buildings, cities and broken files: everything fitted is hidden by what it was fitted into."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import scenegraph as sg
from data_files import require_data
from mesh_proofs import assert_hidden
from scenegraph import Mesh, SceneError
from scenegraph.meshes import fit_occluders, occluders_for

pytestmark = pytest.mark.data


def meshes_of(path: Path) -> Iterator[Mesh]:
    """The meshes of a file, those of the largest boxes first."""
    found = {id(n.mesh): n.mesh for n in sg.Scene.load(path).root.walk() if isinstance(n, sg.Geode)}
    yield from sorted(found.values(), key=lambda m: -float(np.nan_to_num(np.ptp(m.bounds, axis=0)).prod()))


@pytest.mark.parametrize(
    ("file", "covered", "least"),
    [
        ("bunny_res3.ply", True, 0.6),
        ("bunny_res3.ply", False, 0.0),
        ("armadillo_30k.ply", False, 0.55),
        ("dragon_res4.ply", False, 0.55),
    ],
)
def test_scans(file: str, covered: bool, least: float, rng: np.random.Generator) -> None:
    (mesh,) = meshes_of(require_data() / "meshes" / file)
    fitted = fit_occluders(mesh, openings="outward" if covered else "none")
    assert bool(fitted.solids) == (least > 0)
    assert fitted.coverage >= least
    assert fitted.is_covered == covered
    assert_hidden(mesh, fitted, rng, 30)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "least"),
    [("horse.ply", 0.6), ("bunny.ply", 0.6), ("armadillo_86k.ply", 0.6), ("dragon_res2.ply", 0.6)],
)
@pytest.mark.parametrize("shape", ["box", "polytope"])
def test_large_scans(file: str, least: float, shape: str, rng: np.random.Generator) -> None:
    (mesh,) = meshes_of(require_data() / "meshes" / file)
    fitted = fit_occluders(mesh, shape=shape, openings="any")
    assert fitted.coverage >= (least if shape == "polytope" else 0.4)
    assert_hidden(mesh, fitted, rng, 15)


@pytest.mark.parametrize(
    ("file", "count", "least"),
    [
        ("scenes/duplex_building.glb", 8, 0.9),
        ("scenes/virtual_city.glb", 12, 0.4),
        ("city/delft_3dfier.obj", 25, 0.1),
        ("city/ingolstadt_lod3.obj", 8, 0.5),
    ],
)
def test_buildings_and_cities(file: str, count: int, least: float, rng: np.random.Generator) -> None:
    coverage = []
    for mesh in list(meshes_of(require_data() / file))[:count]:
        fitted = fit_occluders(mesh, openings="outward", cells=24)
        assert_hidden(mesh, fitted, rng, 20)
        coverage.append(fitted.coverage)
    assert np.mean(coverage) >= least


def test_broken_files(rng: np.random.Generator) -> None:
    read = 0
    for path in sorted((require_data() / "hostile").iterdir()):
        try:
            found = list(meshes_of(path))
        except SceneError:
            continue
        for mesh in found:
            read += 1
            for openings in ("none", "any"):
                fitted = fit_occluders(mesh, openings=openings, cells=16, max_occluders=4)
                assert fitted.occluders or fitted.reason
                assert_hidden(mesh, fitted, rng, 10)
                assert all(isinstance(o.node(), sg.Occluder) for o in fitted.occluders)
    assert read > 10


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.parametrize("file", ["scenes/virtual_city.glb", "scenes/duplex_building.glb"])
def test_nothing_visible_is_hidden_by_fitted_occluders(file: str, rng: np.random.Generator) -> None:
    """Eyes anywhere, inside walls too, against the item buffer."""
    from scenegraph.render.item_buffer import ItemBuffer

    scene = sg.Scene.load(require_data() / file)
    found = occluders_for(scene, openings="outward", max_meshes=100, cells=32)
    found.attach()
    snapshot = scene.snapshot()
    low = (snapshot.boxes[:3] - snapshot.boxes[3:]).min(axis=1)
    high = (snapshot.boxes[:3] + snapshot.boxes[3:]).max(axis=1)
    size = float(np.linalg.norm(high - low))
    truth = ItemBuffer(snapshot)
    hidden = 0
    with sg.Pipeline.parse("frustum | shadow(active=60)") as pipeline, sg.Pipeline.parse("frustum") as plain:
        pipeline.open(snapshot)
        plain.open(snapshot)
        for _ in range(60):
            eye, target = rng.uniform(low, high), rng.uniform(low, high)
            view = sg.View(eye, target, up=scene.up, width=320, height=200, near=5e-4 * size, far=3 * size)
            kept = pipeline.run(view).visible
            hidden += int(plain.run(view).visible.sum()) - int(kept.sum())
            assert not (truth.render(view).visible & ~kept).any()
    assert hidden > 0
