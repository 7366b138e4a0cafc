"""Metrics against numbers worked out by hand, and against what they must be for any input."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from scenegraph.compare import metrics

bools = hnp.arrays(bool, st.shared(st.integers(0, 20), key="n"))
images = hnp.arrays(np.uint8, st.shared(st.tuples(*[st.integers(1, 14)] * 2), key="hw").map(lambda s: (*s, 3)))


def test_sets_by_hand() -> None:
    exact = np.array([True, True, True, False, False])
    kept = np.array([True, False, False, True, True])
    assert metrics.false_hides(exact, kept) == 2
    assert metrics.overestimate(exact, kept) == 2
    assert metrics.missing_pixels([7, 5, 0.25, 0, 0], kept) == 5.25


@given(bools, bools)
def test_sets_add_up(exact: np.ndarray, kept: np.ndarray) -> None:
    visible = np.count_nonzero(exact)
    assert np.count_nonzero(kept) == (visible - metrics.false_hides(exact, kept) + metrics.overestimate(exact, kept))
    assert metrics.false_hides(exact, exact) == metrics.overestimate(exact, exact) == 0
    assert metrics.false_hides(exact, ~exact) == visible
    assert metrics.missing_pixels(exact, ~exact) == visible


def test_longest_streak_follows_one_drawable() -> None:
    # 0 is missing in frames 0, 1 and 3; 1 in frames 2 and 3: no drawable for more than two frames on end
    frames = [np.array(f, bool) for f in ([1, 0], [1, 0], [0, 1], [1, 1])]
    assert metrics.longest_streak(frames) == 2
    assert metrics.longest_streak([]) == 0
    assert metrics.longest_streak([np.zeros(0, bool)] * 3) == 0


@given(st.lists(st.booleans(), max_size=30))
def test_longest_streak_is_the_longest_run(frames: list[bool]) -> None:
    text = "".join("x" if f else " " for f in frames)
    longest = max((len(run) for run in text.split()), default=0)
    assert metrics.longest_streak(np.array([f, False]) for f in frames) == longest


def test_level_pops_count_only_what_both_frames_draw() -> None:
    before, after = np.array([0, 1, 2, 0]), np.array([1, 1, 0, 2])
    assert metrics.level_pops(before, after) == 3
    drawn = np.array([True, True, True, False])
    assert metrics.level_pops(before, after, drawn, np.ones(4, bool)) == 2


def test_luminance_weights() -> None:
    image = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8)
    assert metrics.luminance(image) == pytest.approx(np.array([[76.245, 149.685, 29.07, 255.0]]))


def test_snr_by_hand() -> None:
    """Gray 100 beside a reference of 100 and 90: 10 log10((100² + 100²) / 10²) = 10 log10(200)."""
    image = np.full((1, 2, 3), 100, np.uint8)
    reference = image.copy()
    reference[0, 1] = 90
    assert metrics.snr_db(image, reference) == pytest.approx(10 * math.log10(200))
    # the signal is the approximated image, so the answer is not symmetric
    assert metrics.snr_db(reference, image) == pytest.approx(10 * math.log10((100**2 + 90**2) / 100))


def test_psnr_by_hand() -> None:
    image = np.zeros((2, 2, 3), np.uint8)
    reference = image.copy()
    reference[0, 0, 0] = 12  # mean squared error 144 / 12
    assert metrics.psnr_db(image, reference) == pytest.approx(10 * math.log10(255**2 / 12))


def test_wrong_pixels_by_hand() -> None:
    image = np.zeros((2, 3, 3), np.uint8)
    other = image.copy()
    other[0, 0] = 1
    other[1, 2, 2] = 255
    assert metrics.wrong_pixels(image, other) == 2


def test_black_image_of_something() -> None:
    black = np.zeros((3, 3, 3), np.uint8)
    assert metrics.snr_db(black, black + np.uint8(9)) == -math.inf


@given(images)
def test_equal_images(image: np.ndarray) -> None:
    assert metrics.wrong_pixels(image, image) == 0
    assert metrics.snr_db(image, image) == metrics.psnr_db(image, image) == math.inf
    assert metrics.ssim(image, image) == pytest.approx(1.0)


@given(images, images)
def test_different_images(image: np.ndarray, other: np.ndarray) -> None:
    wrong = metrics.wrong_pixels(image, other)
    assert 0 <= wrong <= image.shape[0] * image.shape[1]
    assert (metrics.psnr_db(image, other) == math.inf) == (wrong == 0)
    assert metrics.psnr_db(image, other) == metrics.psnr_db(other, image)
    assert -1 <= metrics.ssim(image, other) <= 1 + 1e-12


def test_images_of_different_size() -> None:
    with pytest.raises(ValueError, match="different size"):
        metrics.snr_db(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 3, 3), np.uint8))


def slow_ssim(x: np.ndarray, y: np.ndarray) -> float:
    """The paper's definition, window by window."""
    offsets = np.arange(11) - 5
    line = np.exp(-(offsets**2) / (2 * 1.5**2))
    window = np.outer(line, line) / np.outer(line, line).sum()
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    values = []
    for i in range(x.shape[0] - 10):
        for j in range(x.shape[1] - 10):
            a, b = x[i : i + 11, j : j + 11], y[i : i + 11, j : j + 11]
            ma, mb = (window * a).sum(), (window * b).sum()
            va, vb = (window * (a - ma) ** 2).sum(), (window * (b - mb) ** 2).sum()
            cov = (window * (a - ma) * (b - mb)).sum()
            values.append((2 * ma * mb + c1) * (2 * cov + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2)))
    return float(np.mean(values))


def test_ssim_is_the_papers(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (17, 23, 3)).astype(np.uint8)
    other = np.clip(image + rng.normal(0, 40, image.shape), 0, 255).astype(np.uint8)
    expected = slow_ssim(metrics.luminance(image), metrics.luminance(other))
    assert metrics.ssim(image, other) == pytest.approx(expected, abs=1e-9)
    assert expected < 0.99


def test_spread() -> None:
    s = metrics.spread([4.0, 1.0, 2.0, 3.0, 5.0])
    assert (s.mean, s.low, s.median, s.high, s.worst) == (3.0, 2.0, 3.0, 4.0, 5.0)
    assert s.p95 == pytest.approx(4.8)
    assert all(math.isnan(v) for v in metrics.spread([]).to_dict().values())


def test_infinite_decibels_are_counted_and_not_averaged() -> None:
    d = metrics.decibels([math.inf, 20.0, 30.0, math.inf])
    assert (d.mean_of_finite, d.equal_frames, d.minimum) == (25.0, 2, 20.0)
    assert metrics.decibels([math.inf] * 3) == metrics.Decibels(None, 3, math.inf, math.inf)
    assert math.isnan(metrics.decibels([]).minimum)


@given(st.lists(st.one_of(st.floats(-50, 100), st.just(math.inf)), min_size=1))
def test_decibels_are_numbers(values: list[float]) -> None:
    d = metrics.decibels(values)
    assert d.minimum == min(values)
    assert d.minimum <= d.p5
    assert d.p5 in values
    assert (d.mean_of_finite is None) == (d.equal_frames == len(values))
    assert d.mean_of_finite is None or math.isfinite(d.mean_of_finite)


def test_share() -> None:
    assert metrics.share(1, 4) == 0.25
    assert metrics.share(0, 0) == 0
    assert metrics.share(3, 0) == math.inf
