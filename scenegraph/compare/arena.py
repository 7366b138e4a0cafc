"""Everything that a run keeps open, and what happens on each of its views."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from scenegraph.compare.contest import Contestant, Drawn, Opt
from scenegraph.compare.judge import IN_LOG, Judge, missing_mask
from scenegraph.compare.metrics import Image
from scenegraph.compare.overhead import Overhead
from scenegraph.compare.results import FrameResult, OptFrame, Pictures, RunResult, Shot
from scenegraph.compare.sources import PathView
from scenegraph.compare.suite import Suite
from scenegraph.log import FrameLog
from scenegraph.progress import Progress
from scenegraph.registry import Registry
from scenegraph.snapshot import Snapshot

if TYPE_CHECKING:
    from scenegraph.render.item_buffer import ExactVisibleSet


class Arena:
    """The contestants, OPT and the truth of a run.

    Parameters
    ----------
    suite : Suite
    registry : Registry
    snapshot : Snapshot
    run : RunResult
        Filled while views are drawn.
    """

    def __init__(self, suite: Suite, registry: Registry, snapshot: Snapshot, run: RunResult) -> None:
        self._suite = suite
        self._registry = registry
        self._snapshot = snapshot
        self._run = run
        self._size = (suite.width, suite.height)
        self._contestants: list[Contestant] = []
        self._opened: list[Any] = []
        self._judge = Judge(registry)
        self._best = (-1.0, -1)

    def open(self, tell: Progress) -> None:
        """Open a window for every contestant."""
        from scenegraph.render.item_buffer import ItemBuffer

        background = self._snapshot.scene.background
        for spec in self._suite.pipelines:
            tell(f"opening {spec.name}", 0.0)
            contestant = Contestant(spec, self._registry, self._snapshot, self._size, background, tell)
            self._opened.append(contestant)
            self._contestants.append(contestant)
            self._run.pipelines[spec.name] = contestant.result
        self._opt = Opt(self._snapshot, self._size, background)
        self._opened.append(self._opt)
        self._item_buffer = ItemBuffer(self._snapshot)
        self._opened.append(self._item_buffer)

    def __enter__(self) -> Arena:
        return self

    def __exit__(self, *_: object) -> None:
        for opened in reversed(self._opened):
            opened.close()

    def warm_up(self, at: PathView) -> None:
        """Draw a view with everything, and keep nothing but the time of the very first frame."""
        for contestant in self._contestants:
            start = perf_counter()
            contestant.draw(at.view, 0, at.path)
            contestant.result.first_frame_ms = contestant.result.first_frame_ms or 1e3 * (perf_counter() - start)
        self._opt.draw(at.view, self._truth(at).visible)
        self._run.truth_ms.clear()

    def draw(self, at: PathView, index: int, log: FrameLog) -> None:
        """Draw and judge one view; nothing is recorded before every contestant has finished it."""
        truth = self._truth(at)
        drawn: dict[str, Drawn] = {}
        opt_ms = 0.0
        # Turning order: whoever comes first finds the caches as the last view left them.
        order: list[Contestant | Opt] = [*self._contestants, self._opt]
        turn = index % len(order)
        for one in order[turn:] + order[:turn]:
            if isinstance(one, Opt):
                opt_ms = one.draw(at.view, truth.visible)
            else:
                drawn[one.spec.name] = one.draw(at.view, index, at.path)
        reference = self._reference(at, drawn)
        judged = {name: self._judge.judge(name, d, at, index, truth, reference) for name, d in drawn.items()}
        counts = self._snapshot.triangles[0]
        self._run.opt.append(
            OptFrame(
                index,
                opt_ms,
                int(np.count_nonzero(truth.visible)),
                int(counts[truth.visible].sum(dtype=np.int64)),
            )
        )
        for name, result in self._run.pipelines.items():
            frame = judged[name]
            result.frames.append(frame)
            self._judge.remember(name, drawn[name], at, truth)
            extra = {key: getattr(frame, key) for key in IN_LOG}
            log.append(name, drawn[name].frame.record, **extra, **frame.metrics)
        self._consider(at, index, truth, reference, drawn, judged)

    def finish(self) -> None:
        """Look at the chosen view from above, and sum up what only a whole path tells."""
        for name, result in self._run.pipelines.items():
            result.longest_streak = self._judge.longest_streak(name, self._snapshot.n)
        for name, reason in self._judge.failures.items():
            self._run.notes.append(f"The metric {name} failed and counts as not a number ({reason}).")
        # Pipelines on one snapshot draw from the same arrays.
        self._run.memory["arrays to draw from"] = max(c.result.memory_bytes for c in self._contestants)
        if self._run.pictures is not None:
            with Overhead(self._snapshot, self._run.pictures) as overhead:
                overhead.photograph()

    def _truth(self, at: PathView) -> ExactVisibleSet:
        start = perf_counter()
        truth = self._item_buffer.render(at.view, supersample=self._suite.supersample)
        self._run.truth_ms.append(1e3 * (perf_counter() - start))
        return truth

    def _reference(self, at: PathView, drawn: dict[str, Drawn]) -> Image:
        for contestant in self._contestants:
            if contestant.hides_nothing:
                return drawn[contestant.spec.name].image
        self._opt.draw(at.view, np.ones(self._snapshot.n, bool))
        return self._opt.image()

    def _consider(
        self,
        at: PathView,
        index: int,
        truth: ExactVisibleSet,
        reference: Image,
        drawn: dict[str, Drawn],
        judged: dict[str, FrameResult],
    ) -> None:
        """Keep this view for the report if it tells more than the best so far."""
        missing = sum(f.missing_pixels for f in judged.values())
        score = (missing, int(np.count_nonzero(truth.visible)))
        if score <= self._best:
            return
        self._best = score
        self._run.pictures = Pictures(
            view=at.view,
            path=at.path,
            index=index,
            reason="the view in which most pixels are missing" if missing else "the view in which most is visible",
            exact=truth.visible.copy(),
            reference=reference,
            shots={
                name: Shot(
                    image=drawn[name].image,
                    kept=drawn[name].kept,
                    missing=missing_mask(truth, drawn[name].kept),
                    wrong=(drawn[name].image != reference).any(-1),
                )
                for name in self._run.pipelines
            },
        )
