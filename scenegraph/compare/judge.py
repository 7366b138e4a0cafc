"""One frame of one pipeline held against the truth of its view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scenegraph.compare import metrics
from scenegraph.compare.contest import Drawn
from scenegraph.compare.metrics import Image, Rows
from scenegraph.compare.results import FrameResult, StageShare
from scenegraph.compare.sources import PathView
from scenegraph.registry import Registry

if TYPE_CHECKING:
    from scenegraph.render.item_buffer import ExactVisibleSet

#: What the log has of a frame beside the pipeline's own record; metrics of plugins come behind.
IN_LOG = (
    "path",
    "draw_ms",
    "apply_ms",
    "visible_objects",
    "false_hides",
    "missing_pixels",
    "overestimate",
    "wrong_pixels",
    "snr_db",
    "psnr_db",
    "ssim",
    "level_pops",
)


class Judge:
    """Counts what is wrong with frames.

    Parameters
    ----------
    known : Registry
        Its metrics are measured beside the built-in ones.

    Attributes
    ----------
    failures : dict of str to str
        Metrics of plugins that raised, and why; they count as NaN.
    """

    def __init__(self, known: Registry) -> None:
        self._known = known
        self._last: dict[tuple[str, str], Drawn] = {}
        self._missing: dict[str, dict[str, list[NDArray[np.int64]]]] = {}
        self.failures: dict[str, str] = {}

    def judge(
        self, name: str, drawn: Drawn, at: PathView, index: int, truth: ExactVisibleSet, reference: Image
    ) -> FrameResult:
        """Judge a pipeline's frame by the truth of its view and by the frame that hides nothing."""
        record = drawn.frame.record
        equal = np.array_equal(drawn.image, reference)
        last = self._last.get((name, at.path))
        pops = 0 if last is None else metrics.level_pops(last.frame.level, drawn.frame.level, last.kept, drawn.kept)
        return FrameResult(
            path=at.path,
            index=index,
            cull_ms=record.cull_ms,
            draw_ms=drawn.draw_ms,
            apply_ms=drawn.apply_ms,
            drawn_objects=drawn.frame.drawn_objects,
            drawn_triangles=record.triangles,
            visible_objects=int(np.count_nonzero(truth.visible)),
            false_hides=metrics.false_hides(truth.visible, drawn.kept),
            missing_pixels=metrics.missing_pixels(truth.pixels, drawn.kept) / truth.supersample**2,
            overestimate=metrics.overestimate(truth.visible, drawn.kept),
            wrong_pixels=metrics.wrong_pixels(drawn.image, reference),
            snr_db=metrics.snr_db(drawn.image, reference),
            psnr_db=metrics.psnr_db(drawn.image, reference),
            ssim=1.0 if equal else metrics.ssim(drawn.image, reference),
            level_pops=pops,
            host_ms=record.host_ms,
            stages=tuple(StageShare(s.name, s.ms, s.tested, s.hidden, s.coarsened, s.skipped) for s in record.stages),
            metrics={key: self._measured(key, drawn, truth, reference) for key in self._known.metrics},
        )

    def remember(self, name: str, drawn: Drawn, at: PathView, truth: ExactVisibleSet) -> None:
        """Take note of a frame that counts, for what only a path as a whole can tell."""
        self._last[name, at.path] = drawn
        missing = np.flatnonzero(truth.visible & ~drawn.kept)
        self._missing.setdefault(name, {}).setdefault(at.path, []).append(missing)

    def longest_streak(self, name: str, drawables: int) -> int:
        """Find the longest run of frames in which one drawable was missing, over all paths."""

        def mask(rows: NDArray[np.int64]) -> Rows:
            found = np.zeros(drawables, bool)
            found[rows] = True
            return found

        paths = self._missing.get(name, {}).values()
        return max((metrics.longest_streak(map(mask, path)) for path in paths), default=0)

    def _measured(self, key: str, drawn: Drawn, truth: ExactVisibleSet, reference: Image) -> float:
        try:
            return float(self._known.metrics[key].build(drawn.frame, truth, drawn.image, reference))
        except Exception as error:  # a stranger's metric must not cost the run
            self.failures[key] = f"{type(error).__name__}: {error}"
            return float("nan")


def missing_mask(truth: ExactVisibleSet, kept: Rows) -> NDArray[np.bool_]:
    """(h, w) pixels with a sample of a drawable that was not kept."""
    hidden = np.append(~kept, False)[truth.ids]
    height, width, k = *truth.ids.shape, truth.supersample
    return np.asarray(hidden.reshape(height // k, k, width // k, k).any((1, 3)))
