"""Boxes for a rasterizer: grown enough at every scale, facing outward, and unknown where they reach the near plane."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph import View
from scenegraph.kernels.boxes import box_area, box_distance
from scenegraph.kernels.proxies import CORNER_SIGNS, TRIANGLES, box_clip_corners

SIZE = np.array([640.0, 480.0])


def proxies(view: View, boxes: np.ndarray, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    left, right, bottom, top = view.window
    return box_clip_corners(
        np.asarray(boxes, float).reshape(6, -1),
        axes=view.axes,
        eye=np.asarray(view.eye),
        projection=view.projection(),
        pixels=(view.width / (right - left), view.height / (top - bottom)),
        near=view.near,
        parallel=view.is_parallel,
        **{"step": 0.01, "reach": 0.0} | options,
    )


def exact_corners(view: View, boxes: np.ndarray) -> np.ndarray:
    """(k, 8, 4) in clip space, in double precision."""
    center, half = boxes[:3] - np.asarray(view.eye)[:, None], np.abs(boxes[3:])
    eyed = view.axes @ (center[:, :, None] + half[:, :, None] * CORNER_SIGNS[:, None]).reshape(3, -1)
    clip = view.projection() @ np.concatenate([eyed, np.ones((1, eyed.shape[1]))])
    return clip.T.reshape(boxes.shape[1], 8, 4)


def pixels(clip: np.ndarray) -> np.ndarray:
    return (clip[..., :2] / clip[..., 3:] + 1) / 2 * SIZE


views = st.builds(
    lambda a, fov, scale, far: View(
        scale * np.array([np.cos(a), np.sin(a), 0.3]) * 10, (0, 0, 0), fov=fov, near=0.1 * scale, far=far * scale,
        width=640, height=480,
    ),
    st.floats(0, 6.28), st.floats(1.0, 150.0), st.sampled_from([1e-9, 1.0, 1e7]), st.sampled_from([30.0, 1e6]),
)  # fmt: skip


@given(views, st.integers(0, 2**32 - 1), st.floats(0.0, 2.0), st.sampled_from([None, 3.0]))
def test_boxes_grow_on_every_side_and_come_nearer(view: View, seed: int, margin: float, parallel: float | None) -> None:
    scale = view.near / 0.1
    if parallel is not None:
        view = View(
            view.eye, view.target, near=view.near, far=view.far, width=640, height=480, parallel_scale=parallel * scale
        )
    rng = np.random.default_rng(seed)
    boxes = np.concatenate([rng.uniform(-3, 3, (3, 20)), 10.0 ** rng.uniform(-6, 0.3, (3, 20))]) * scale
    boxes[3:, :3] = 0.0
    corners, unknown = proxies(view, boxes, step=0.01, margin=margin)
    exact = exact_corners(view, boxes)[~unknown]
    grown = corners[~unknown].astype(float)
    before, after = pixels(exact), pixels(grown)
    # half of the growth is for the snapping of what is drawn
    enough = 0.02 + margin - 1e-3
    assert (after.min(axis=1) <= before.min(axis=1) - enough).all()
    assert (after.max(axis=1) >= before.max(axis=1) + enough).all()
    nearest, was = (grown[..., 2] / grown[..., 3]).min(axis=1), (exact[..., 2] / exact[..., 3]).min(axis=1)
    assert (nearest < was).all()


def test_the_rounding_of_contents_is_covered() -> None:
    view = View((0, 0, 0), (0, 1, 0), near=0.1, far=100, width=640, height=480)
    box = np.array([[0.0], [10.0], [0.0], [1.0], [1.0], [1.0]])
    plain, far = (proxies(view, box, reach=reach)[0][0].astype(float) for reach in (0.0, 1e6))
    rounding = 1e6 * np.finfo(np.float32).eps
    assert (pixels(far).max(axis=0) - pixels(plain).max(axis=0) > rounding * view.height / 10).all()
    assert (far[:, 2] / far[:, 3]).min() < (plain[:, 2] / plain[:, 3]).min() - rounding / 10


def test_triangles_face_outward() -> None:
    corners = CORNER_SIGNS.T[TRIANGLES.reshape(12, 3)]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normal * corners.mean(axis=1)).sum(axis=1) > 0).all()
    edges = np.concatenate([TRIANGLES.reshape(12, 3)[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    # closed: every edge is walked once in each direction
    assert len(np.unique(edges, axis=0)) == 36
    assert {tuple(e) for e in edges.tolist()} == {tuple(e[::-1]) for e in edges.tolist()}


@pytest.mark.parametrize("parallel", [None, 5.0])
def test_what_is_unknown(parallel: float | None) -> None:
    view = View((0, 0, 0), (0, 1, 0), near=0.1, far=100, width=640, height=480, parallel_scale=parallel)
    nan, inf = np.nan, np.inf
    boxes = {
        (0, 0, 0, 1, 1, 1): True, (0, 0.1, 0, 1e-12, 1e-12, 1e-12): True, (50, 0, 0, 1, 0.2, 1): True,
        (0, 5, 0, 1, 1, 1): False, (0, 5, 0, 0, 0, 0): False, (0, -5, 0, 1, 1, 1): False, (0, 5, 0, -1, -1, -1): False,
        (nan, 5, 0, 1, 1, 1): True, (0, 5, 0, 1, nan, 1): True, (0, 5, 0, inf, 1, 1): True, (0, inf, 0, 1, 1, 1): True,
        (0, 1e300, 0, 1, 1, 1): True, (0, 500, 0, 1, 1, 1): False,
    }  # fmt: skip
    corners, unknown = proxies(view, np.array(list(boxes), float).T)
    assert unknown.tolist() == list(boxes.values())
    assert not corners[unknown].any()
    assert np.isfinite(corners).all()
    inverted, plain = corners[6], corners[3]
    assert np.array_equal(inverted, plain)


def test_no_boxes() -> None:
    view = View((0, 0, 0), (0, 1, 0))
    corners, unknown = proxies(view, np.zeros((6, 0)))
    assert corners.shape == (0, 8, 4)
    assert unknown.shape == (0,)


def test_distance_and_area() -> None:
    boxes = np.array([[0, 0, 0, 1, 2, 3], [10, 0, 0, 1, 2, -3], [4, 5, 0, 1, 1, 1], [np.nan, 0, 0, 1, 1, 1]]).T
    assert box_distance(boxes, np.zeros(3)).tolist() == [0.0, 9.0, 5.0, 0.0]
    assert box_area(boxes).tolist() == [88.0, 88.0, 24.0, 24.0]
