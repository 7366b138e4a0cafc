"""Records of what each stage did and cost, and the files they are written to."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from .json_text import json_text


@dataclass
class StageRecord:
    """One stage in one frame.

    Attributes
    ----------
    name : str
    ms, start_ms : float
        Time of `run` with the host's bookkeeping for it, and when it began after the start of the frame.
    tested, hidden, coarsened : int
        Boxes asked; rows hidden; rows moved to a coarser level.
    triangles_before, triangles_after : int
    queries : int
        GL queries issued.
    skipped : str or None
        Why the stage did not run.
    counts : dict
        The stage's own counters.
    """

    name: str
    ms: float = 0.0
    start_ms: float = 0.0
    tested: int = 0
    hidden: int = 0
    coarsened: int = 0
    triangles_before: int = 0
    triangles_after: int = 0
    queries: int = 0
    skipped: str | None = None
    counts: dict[str, float] = field(default_factory=dict)


@dataclass
class FrameRecord:
    """One frame of one pipeline: `cull_ms` is measured around all, `host_ms` is what the stages' times leave of it.

    `draw_ms` is set by whoever draws the frame, and None until then: the next frame's stages may look at it.
    """

    index: int = 0
    cull_ms: float = 0.0
    host_ms: float = 0.0
    visible: int = 0
    triangles: int = 0
    draw_ms: float | None = None
    stages: list[StageRecord] = field(default_factory=list)


#: Columns of a stage in the CSV.
STAGE_COLUMNS = ("ms", "tested", "hidden", "coarsened", "triangles_after", "queries", "skipped")


class FrameLog:
    """Collects frame records of named pipelines; with `stream` each frame is on disk as soon as it is done.

    Parameters
    ----------
    stream : path, optional
        A CSV that is written while the run goes on, so that an interrupted run leaves its finished frames. Long form:
        one line for the frame, whose stage is called "*", and one for each of its stages.
    extra : sequence of str
        Names of the values handed to `append` that get columns of their own in the CSV.
    """

    COLUMNS = ("pipeline", "frame", "stage", *STAGE_COLUMNS, "cull_ms", "host_ms", "visible", "triangles", "counts")

    def __init__(self, stream: str | Path | None = None, *, extra: Sequence[str] = ()) -> None:
        self.columns = (*self.COLUMNS, *extra)
        self.entries: list[tuple[str, FrameRecord, dict[str, Any]]] = []
        self._file: TextIO | None = None
        if stream is not None:
            self._file = open(stream, "w", newline="", encoding="utf-8")  # noqa: SIM115 - closed by close()
            csv.writer(self._file).writerow(self.columns)
            self._file.flush()

    def __enter__(self) -> FrameLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the stream."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def append(self, pipeline: str, record: FrameRecord, **extra: Any) -> None:
        """Add one frame; `extra` (draw_ms, false_hides, ...) goes into the files with it."""
        self.entries.append((pipeline, record, extra))
        if self._file is not None:
            csv.writer(self._file).writerows(self._csv_rows(pipeline, record, extra))
            self._file.flush()

    def write_csv(self, path: str | Path) -> None:
        """All frames, as a stream has them."""
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            for pipeline, record, extra in self.entries:
                writer.writerows(self._csv_rows(pipeline, record, extra))

    def _csv_rows(self, pipeline: str, record: FrameRecord, extra: Mapping[str, Any]) -> list[list[Any]]:
        whole = [f"{record.cull_ms:.4f}", f"{record.host_ms:.4f}", record.visible, record.triangles]
        own = [extra.get(name, "") for name in self.columns[len(self.COLUMNS) :]]
        blank = [""] * (len(STAGE_COLUMNS) - 1)
        rows: list[list[Any]] = [[pipeline, record.index, "*", whole[0], *blank, *whole, "", *own]]
        for stage in record.stages:
            ms, *values = (getattr(stage, column) for column in STAGE_COLUMNS)
            done = [f"{ms:.4f}", *("" if value is None else value for value in values)]
            counts = json_text(stage.counts) if stage.counts else ""
            rows.append([pipeline, record.index, stage.name, *done, *whole, counts, *[""] * len(own)])
        return rows

    def write_jsonl(self, path: str | Path) -> None:
        """One JSON object per frame."""
        with Path(path).open("w", encoding="utf-8") as file:
            for pipeline, record, extra in self.entries:
                file.write(json_text({"pipeline": pipeline, **asdict(record), **extra}) + "\n")

    def write_trace(self, path: str | Path) -> None:
        """Chrome/Perfetto trace: one track per pipeline, frames laid end to end, stages nested in them."""
        events: list[dict[str, Any]] = []
        clock: dict[str, float] = {}
        for pipeline, record, extra in self.entries:
            if pipeline not in clock:
                clock[pipeline] = 0.0
                name = {"name": pipeline}
                events.append({"ph": "M", "pid": 1, "tid": len(clock), "name": "thread_name", "args": name})
            tid = list(clock).index(pipeline) + 1
            start = clock[pipeline]
            draw = _exact(float(extra.get("draw_ms") or record.draw_ms or 0.0))
            cull = _exact(record.cull_ms)
            events.append(_event(tid, f"frame {record.index}", start, cull + draw, {**extra}))
            events.append(_event(tid, "cull", start, cull, {"visible": record.visible}))
            events.extend(
                _event(tid, stage.name, start + _exact(stage.start_ms), _exact(stage.ms), {"hidden": stage.hidden})
                for stage in record.stages
                if stage.skipped is None
            )
            if draw:
                events.append(_event(tid, "draw", start + cull, draw, {"triangles": record.triangles}))
            clock[pipeline] = start + cull + draw
        Path(path).write_text(json_text({"traceEvents": events, "displayTimeUnit": "ms"}), encoding="utf-8")


def _exact(ms: float) -> float:
    """Cut to 2⁻²⁰ ms, about a nanosecond: sums of such times are exact, so that no event seems to outlast the next."""
    return int(ms * 2**20) / 2**20


def _event(tid: int, name: str, start_ms: float, ms: float, args: Mapping[str, Any]) -> dict[str, Any]:
    safe = {k: v for k, v in args.items() if isinstance(v, (int, float, str)) and v == v}
    return {"ph": "X", "pid": 1, "tid": tid, "name": name, "ts": start_ms * 1e3, "dur": ms * 1e3, "args": safe}
