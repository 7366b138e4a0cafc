"""Pipeline: an ordered list of stages, checked before the first frame, run and timed on every view."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from time import perf_counter_ns
from types import TracebackType
from typing import Any

import numpy as np

from .errors import PipelineError
from .frame import Frame
from .log import StageRecord
from .progress import Progress, silent
from .registry import Registry, registry
from .skipping import Worth
from .snapshot import Snapshot
from .stage import Guarantee, Stage, parse_stages
from .threads import one_blas_thread
from .view import View

#: Needs that are not preparations.
_SERVICES = ("gl",)

_STRENGTH = (Guarantee.EXACT, Guarantee.CONSERVATIVE, Guarantee.AGGRESSIVE, Guarantee.APPROXIMATE)


class Pipeline:
    """Stages in the order in which they run.

    Parameters
    ----------
    stages : iterable of Stage
    name : str, optional
        For logs and reports; the text of the pipeline without.
    adaptive : bool, default False
        Skip a stage for a while when its measured time exceeds the drawing time it saves. Off in suites, because what
        is skipped then depends on the clock and a run cannot be replayed.
    preparations : Registry, optional
        Where the stages' needs are looked up.

    Examples
    --------
    >>> with Pipeline.parse("frustum | contribution(pixels=2)") as pipeline:
    ...     pipeline.open(scene.snapshot())
    ...     frame = pipeline.run(view)
    """

    def __init__(
        self,
        stages: Iterable[Stage] = (),
        *,
        name: str = "",
        adaptive: bool = False,
        preparations: Registry | None = None,
    ) -> None:
        self.stages: tuple[Stage, ...] = tuple(stages)
        self.name = name or self.text
        self.adaptive = adaptive
        #: Stages switched off by name: they are skipped, and the log says so.
        self.disabled: set[str] = set()
        self.worth = Worth()
        #: The stage at work; after an exception from `open` or `run`, the one that raised it.
        self.running: Stage | None = None
        self._registry = preparations
        self._snapshot: Snapshot | None = None
        self._device: Any = None
        self._progress: Progress = silent
        self._structure = -1
        self._opened: list[Stage] = []
        self._previous: dict[str, Frame] = {}
        self._index = 0

    @classmethod
    def parse(cls, text: str, known: Registry | None = None, *, name: str = "", adaptive: bool = False) -> Pipeline:
        """From a text such as ``frustum | shadow(occluders="solid", active=15)``; "none" or "" has no stages.

        Raises
        ------
        PipelineError
            All faults at once: syntax, unknown stages and parameters, values out of range, and the chain.
        """
        known = registry() if known is None else known
        faults: list[str] = []
        stages: list[Stage] = []
        for stage_name, values in parse_stages(text):
            if stage_name not in known.stages:
                faults.append(known.unknown_stage(stage_name))
                continue
            try:
                stages.append(known.stages[stage_name](**values))
            except PipelineError as error:
                faults.extend(error.faults)
        pipeline = cls(stages, name=name, adaptive=adaptive, preparations=known)
        faults.extend(pipeline.faults())
        if faults:
            raise PipelineError(faults)
        return pipeline

    # -- asking ---------------------------------------------------------------------------------------------------

    @property
    def text(self) -> str:
        """The text form; parsing it gives an equal pipeline."""
        return " | ".join(stage.text for stage in self.stages) or "none"

    def __repr__(self) -> str:
        return f"<Pipeline {self.text}>"

    @property
    def guarantee(self) -> Guarantee:
        """The weakest of the stages' guarantees; an empty pipeline hides nothing and is conservative."""
        weakest = max((_STRENGTH.index(s.guarantee) for s in self.stages), default=1)
        return _STRENGTH[max(weakest, 1)]

    @property
    def needs(self) -> set[str]:
        """All that the stages need."""
        return {need for stage in self.stages for need in stage.needs}

    def faults(self) -> list[str]:
        """What is wrong with the chain, one sentence each."""
        known = registry() if self._registry is None else self._registry
        found: list[str] = []
        written: set[type] = set()
        for position, stage in enumerate(self.stages):
            for kind in stage.reads:
                if kind not in written:
                    makers = sorted(n for n, s in known.stages.items() if kind in s.writes)
                    cure = f"put {' or '.join(makers)} before it" if makers else "no installed stage makes one"
                    found.append(f"stage {stage.name!r} reads {kind.__name__}, which no stage before it puts; {cure}")
            for need in stage.needs:
                if need not in _SERVICES and need not in known.preparations:
                    offered = ", ".join(sorted(known.preparations)) or "none"
                    found += [f"stage {stage.name!r} needs {need!r}, which no plugin prepares; there are: {offered}"]
            if any(earlier.name == stage.name for earlier in self.stages[:position]):
                found.append(f"stage {stage.name!r} stands twice in the pipeline; keep one")
            written |= {kind for kind in stage.writes if isinstance(kind, type)}
        return found

    def check(self) -> None:
        """Raise `PipelineError` with all faults of the chain, if there are any."""
        found = self.faults()
        if found:
            raise PipelineError(found)

    # -- running --------------------------------------------------------------------------------------------------

    def __enter__(self) -> Pipeline:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def open(self, snapshot: Snapshot, *, device: Any = None, progress: Progress = silent) -> Pipeline:
        """Prepare every stage for a snapshot and return this pipeline.

        Parameters
        ----------
        snapshot : Snapshot
        device : object, optional
            GL services, for stages that need "gl" (see `scenegraph.render`).
        progress : callable, optional

        Raises
        ------
        PipelineError
            The chain is faulty, or a stage needs "gl" and there is no device.
        """
        self.running = None
        self.check()
        if device is None and "gl" in self.needs:
            wanting = ", ".join(s.name for s in self.stages if "gl" in s.needs)
            raise PipelineError(f"stage {wanting} needs OpenGL, but no device was given; run it in a window")
        self.close()
        self._snapshot, self._device, self._progress = snapshot, device, progress
        self._prepare(snapshot)
        for stage in self.stages:
            self._opened.append(stage)
            self.running = stage
            stage.open(snapshot, progress)
        self.running = None
        return self

    def _prepare(self, snapshot: Snapshot) -> None:
        known = registry() if self._registry is None else self._registry
        self._structure = -1
        # one that changes the snapshot (levels) drops what was prepared before it
        while self._structure != snapshot.structure_version:
            self._structure = snapshot.structure_version
            for need in sorted(self.needs - set(_SERVICES)):
                snapshot.prepared(need, partial(known.preparations[need].build, progress=self._progress))

    def close(self) -> None:
        """Release what the stages hold; the pipeline can be opened again."""
        for stage in reversed(self._opened):
            stage.close()
        self._opened.clear()
        self._previous.clear()
        self._snapshot = None
        self._index = 0

    def run(self, view: View, *, index: int | None = None, view_name: str = "") -> Frame:
        """Run all stages on one view.

        Parameters
        ----------
        view : View
        index : int, optional
            Frame number; counted up without.
        view_name : str
            Views with different names (the walls of a CAVE, say) have separate histories.

        Returns
        -------
        Frame
            `frame.record` tells what each stage did and cost.
        """
        if self._snapshot is None:
            raise PipelineError("run() before open(snapshot)")
        if self._snapshot.structure_version != self._structure:
            self.open(self._snapshot, device=self._device, progress=self._progress)
        begin = perf_counter_ns()
        with one_blas_thread():
            frame = self._run(view, index, view_name, begin)
        # counting triangles is our curiosity, not part of culling: after the clock has stopped
        frame._count_triangles()
        if self.adaptive:
            self._account(frame.record.stages)
        return frame

    def _run(self, view: View, index: int | None, view_name: str, begin: int) -> Frame:
        assert self._snapshot is not None
        previous = self._previous.get(view_name)
        if previous is not None:
            previous.previous = None
            done = previous.record
            if self.adaptive and done.draw_ms is not None:
                self.worth.drawn(objects=done.visible, triangles=done.triangles, ms=done.draw_ms)
        frame = Frame(
            self._snapshot,
            view,
            index=self._index if index is None else index,
            view_name=view_name,
            previous=previous,
            device=self._device,
        )
        self._index = frame.index + 1
        before, coarse = frame.visible_count, 0
        for stage in self.stages:
            start = perf_counter_ns()
            record = StageRecord(stage.name, start_ms=(start - begin) / 1e6)
            frame.record.stages.append(record)
            self.running = stage
            record.skipped = self._skip_reason(stage, frame)
            if record.skipped is None:
                frame._stage, frame._stage_record = stage, record
                try:
                    stage.run(frame)
                finally:
                    frame._stage = frame._stage_record = None
                now = frame.kept_count
                record.hidden, before = before - now, now
                if "level" in stage.writes:
                    coarser = int(np.count_nonzero(frame.level))
                    record.coarsened, coarse = coarser - coarse, coarser
            frame._remember(changed=record.skipped is None, levels="level" in stage.writes)
            record.ms = (perf_counter_ns() - start) / 1e6
        self.running = None
        frame.record.visible = before
        self._previous[view_name] = frame
        frame.record.cull_ms = (perf_counter_ns() - begin) / 1e6
        frame.record.host_ms = frame.record.cull_ms - sum(s.ms for s in frame.record.stages)
        return frame

    def run_views(self, views: Sequence[View], *, index: int | None = None) -> list[Frame]:
        """One frame for each of several views over the same snapshot (the walls of a CAVE)."""
        number = self._index if index is None else index
        return [self.run(view, index=number, view_name=str(i)) for i, view in enumerate(views)]

    def _account(self, records: Sequence[StageRecord]) -> None:
        """Tell what each stage cost and saved; a stage gets credit for those that read what it puts."""
        for i, (stage, record) in enumerate(zip(self.stages, records, strict=True)):
            if record.skipped is None:
                later = zip(self.stages[i + 1 :], records[i + 1 :], strict=True)
                readers = [r for s, r in later if r.skipped is None and set(s.reads) & set(stage.writes)]
                self.worth.ran(record, readers)

    def _skip_reason(self, stage: Stage, frame: Frame) -> str | None:
        if stage.name in self.disabled:
            return "switched off"
        missing = [kind.__name__ for kind in stage.reads if frame.find(kind) is None]
        if missing:
            return f"no stage has put {' or '.join(missing)} into this frame"
        if frame.visible_count < stage.minimum_candidates:
            return f"only {frame.visible_count} candidates left"
        if self.adaptive:
            reason = self.worth.skip(stage.name, frame.index)
            if reason:
                return reason
        return stage.skip(frame)
