"""Inner shells: every point of them is inside the fine mesh, whatever the coarse one is like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenegraph import Mesh
from scenegraph.meshes import DiskCache, inner_shell, tessellate
from scenegraph.meshes.winding import winding_numbers
from scenegraph.scenes.rabbit import bunny
from scenegraph.scenes.shapes import icosphere


def points_on(mesh: Mesh, rng: np.random.Generator, count: int = 300) -> np.ndarray:
    weights = rng.dirichlet((0.5, 0.5, 0.5), count)
    return np.einsum("pk,pkc->pc", weights, mesh.vertices[mesh.faces[rng.integers(0, mesh.triangles, count)]])


def share_of_silhouette(shell: Mesh, fine: Mesh) -> float:
    """Mean over three directions of the hulls' areas: a rough measure of what a shell is worth."""
    from scipy.spatial import ConvexHull

    shares = [
        ConvexHull(np.delete(shell.vertices, axis, 1)).volume / ConvexHull(np.delete(fine.vertices, axis, 1)).volume
        for axis in range(3)
    ]
    return float(np.mean(shares))


@pytest.mark.parametrize("seed", range(2))
def test_all_of_a_shell_is_inside(seed: int, rng: np.random.Generator, tmp_path: Path) -> None:
    coarse = bunny()
    fine = tessellate(coarse, 3 + seed)
    shell = inner_shell(fine, coarse, cells=40 + 8 * seed, cache=DiskCache(tmp_path))
    assert shell is not None
    assert shell.triangles > 0.6 * coarse.triangles
    assert (winding_numbers(points_on(shell, rng), fine.vertices[fine.faces]) != 0).all()
    # the coarse mesh itself is not
    assert (winding_numbers(points_on(coarse, rng), fine.vertices[fine.faces]) == 0).any()


def test_a_shell_of_a_ball_is_nearly_the_ball(tmp_path: Path) -> None:
    points, faces = icosphere(1)
    coarse = Mesh(points, faces, normals=points)
    fine = tessellate(coarse, 5)
    shell = inner_shell(fine, coarse, cells=64, cache=DiskCache(tmp_path))
    assert shell is not None
    assert shell.triangles == coarse.triangles
    assert trimesh.Trimesh(shell.vertices, shell.faces, process=False).is_watertight
    assert share_of_silhouette(shell, fine) > 0.8


def test_a_coarse_mesh_that_lies_elsewhere_gives_none(tmp_path: Path) -> None:
    coarse = bunny()
    away = Mesh(coarse.vertices + 10, coarse.faces)
    assert inner_shell(tessellate(coarse, 2), away, cells=24, cache=DiskCache(tmp_path)) is None


@pytest.mark.parametrize("case", ["open", "flat", "empty", "nan", "large", "translucent"])
def test_what_has_no_inside_gives_none(case: str, tmp_path: Path) -> None:
    coarse = bunny()
    fine = tessellate(coarse, 2)
    if case == "open":
        fine = Mesh(fine.vertices, fine.faces[1:])
    elif case == "flat":
        fine = Mesh(fine.vertices * (1, 1, 0), fine.faces)
    elif case == "empty":
        fine = Mesh(fine.vertices, fine.faces[:0])
    elif case == "nan":
        fine = Mesh(np.where(np.arange(len(fine.vertices))[:, None] == 5, np.nan, fine.vertices), fine.faces)
    elif case == "large":
        coarse = fine
    else:
        fine = Mesh(fine.vertices, fine.faces, color=(1, 1, 1, 0.5))
    assert inner_shell(fine, coarse, cells=24, largest=100, cache=DiskCache(tmp_path)) is None


def test_shells_come_from_the_cache_the_second_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = bunny()
    fine = tessellate(coarse, 2)
    first = inner_shell(fine, coarse, cells=32, cache=DiskCache(tmp_path))
    monkeypatch.setattr("scenegraph.meshes.inner._pulled", lambda *_: pytest.fail("made again"))
    second = inner_shell(fine, coarse, cells=32, cache=DiskCache(tmp_path))
    assert first is not None
    assert second is not None
    assert first.key == second.key
