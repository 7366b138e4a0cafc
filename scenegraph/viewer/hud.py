"""The heads-up display: what is shown, as plain data, and the cards made of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from ..overlay import Color
from ..stage import Stage
from .canvas import ACCENT, BAD, DIM, FAINT, GOOD, TEXT, Canvas, Card, rgb
from .colorings import stage_color
from .keys import Key

#: Frames in the time strip.
STRIP = 200
_WIDTH = 316
_INNER = _WIDTH - 32


@dataclass
class Numbers:
    """What the card of numbers shows.

    Attributes
    ----------
    title, pipeline : str
    frame : Frame or None
    off : str
        Why everything is drawn, or ''.
    stages : sequence of Stage
        All of the pipeline.
    disabled : set of str
    failures : dict of str to str
    history : sequence of (cull_ms, draw_ms)
        The last frames, newest last.
    truth : str
    truth_is_bad : bool
    names : sequence of str
        Of what is falsely hidden.
    state : sequence of str
        Modes that are on.
    legend : sequence of (str, color)
    """

    title: str = ""
    pipeline: str = ""
    frame: Frame | None = None
    off: str = ""
    stages: Sequence[Stage] = ()
    disabled: set[str] = field(default_factory=set)
    failures: dict[str, str] = field(default_factory=dict)
    history: Sequence[tuple[float, float]] = ()
    truth: str = ""
    truth_is_bad: bool = False
    names: Sequence[str] = ()
    state: Sequence[str] = ()
    legend: Sequence[tuple[str, Color]] = ()


def short(number: float) -> str:
    """A count in few characters: 812, 8.3 k, 1.2 M."""
    for limit, unit in ((1e9, " G"), (1e6, " M"), (1e4, " k")):
        if number >= limit:
            digits = number / (1e3 if unit == " k" else limit)
            return f"{digits:.1f}{unit}" if digits < 100 else f"{digits:.0f}{unit}"
    return f"{number:,.0f}"


def numbers_card(numbers: Numbers, scale: float = 1.0) -> Card:
    """Frame rate, stages, what is drawn, truth, and the strip of the last frames."""
    rows = max(len(numbers.stages), 1)
    extra = 22 * bool(numbers.truth) + 17 * len(numbers.names) + 18 * len(numbers.legend) + 22 * bool(numbers.state)
    canvas = Canvas(_WIDTH, 160 + 38 * rows + extra + 22 * bool(numbers.off), scale)
    y = _headline(canvas, numbers)
    y = _stages(canvas, numbers, y)
    y = _drawn(canvas, numbers, y)
    if numbers.truth:
        y += 22
        canvas.knob(20, y - 4, 3.5, BAD if numbers.truth_is_bad else GOOD)
        canvas.text(30, y, canvas.fitted(numbers.truth, _INNER - 14), color=TEXT)
        for name in numbers.names:
            y += 17
            canvas.text(30, y, canvas.fitted(name, _INNER - 14, 12), size=12, color=BAD)
    for label, color in numbers.legend:
        y += 18
        canvas.bar(16, y - 9, 9, 9, rgb(color))
        canvas.text(32, y, label, size=12, color=DIM)
    if numbers.state:
        y += 22
        canvas.text(16, y, canvas.fitted(" · ".join(numbers.state), _INNER), color=ACCENT)
    _strip(canvas, numbers.history, canvas.height - 44)
    return canvas.card()


def _headline(canvas: Canvas, numbers: Numbers) -> float:
    last = numbers.history[-1] if numbers.history else (0.0, 0.0)
    whole = sum(last)
    canvas.text(16, 40, f"{1e3 / whole:.0f}" if whole > 0 else "-", size=30)
    canvas.text(_WIDTH - 16, 24, canvas.fitted(numbers.title, 190, 12), size=12, color=DIM, align="right")
    canvas.text(
        _WIDTH - 16, 41, f"{whole:.1f} ms = {last[0]:.1f} cull + {last[1]:.1f} draw", size=12, color=DIM, align="right"
    )
    canvas.text(16, 56, "frames/s", size=10, color=DIM)
    canvas.text(_WIDTH - 16, 58, canvas.fitted(numbers.pipeline, 230, 12), size=12, color=TEXT, align="right")
    y = 66.0
    if numbers.off:
        y += 18
        canvas.text(16, y, canvas.fitted(numbers.off, _INNER, 12), size=12, color=ACCENT)
    return y


def _stages(canvas: Canvas, numbers: Numbers, y: float) -> float:
    records = {r.name: r for r in numbers.frame.record.stages} if numbers.frame is not None and not numbers.off else {}
    n = numbers.frame.snapshot.n if numbers.frame is not None else 1
    slowest = max([r.ms for r in records.values()] + [1e-6])
    if not numbers.stages:
        canvas.text(16, y + 20, "no stages: everything is drawn", color=DIM)
    for index, stage in enumerate(numbers.stages):
        top = y + 38 * index
        record = records.get(stage.name)
        off = stage.name in numbers.disabled or stage.name in numbers.failures
        canvas.mark(8, top + 4, _WIDTH - 16, 34, "stage", str(index))
        canvas.knob(20, top + 16, 4, FAINT if off else rgb(stage_color(index)))
        canvas.text(32, top + 20, f"{index + 1}  {stage.name}", color=DIM if off else TEXT)
        if stage.name in numbers.failures:
            canvas.text(32, top + 34, canvas.fitted(numbers.failures[stage.name], _INNER - 16, 11), size=11, color=BAD)
            continue
        if record is None or record.skipped:
            why = "off" if stage.name in numbers.disabled else (record.skipped or "") if record else ""
            canvas.text(_WIDTH - 16, top + 20, canvas.fitted(why, 170, 12), size=12, color=DIM, align="right")
            continue
        canvas.text(_WIDTH - 84, top + 20, f"{record.ms:.2f} ms", size=12, color=DIM, align="right")
        canvas.text(_WIDTH - 16, top + 20, f"-{short(record.hidden)}" if record.hidden else "0", align="right")
        canvas.bar(32, top + 27, _INNER - 16, 2, FAINT)
        canvas.bar(32, top + 27, (_INNER - 16) * record.hidden / max(n, 1), 2, rgb(stage_color(index)))
        canvas.bar(32, top + 31, (_INNER - 16) * record.ms / slowest, 1, DIM)
    return y + 38 * max(len(numbers.stages), 1)


def _drawn(canvas: Canvas, numbers: Numbers, y: float) -> float:
    frame = numbers.frame
    if frame is None:
        return y + 18
    snapshot, whole = frame.snapshot, frame.snapshot.n
    total = int(snapshot.triangles[0].sum(dtype="int64")) if whole else 0
    drawn, triangles = (whole, total) if numbers.off else (frame.record.visible, frame.record.triangles)
    y += 18
    canvas.text(16, y, "drawn", color=DIM)
    canvas.text(62, y, f"{drawn:,} of {whole:,} objects")
    canvas.text(_WIDTH - 16, y, f"{short(triangles)} triangles", size=12, color=DIM, align="right")
    return y


def _strip(canvas: Canvas, history: Sequence[tuple[float, float]], y: float) -> None:
    """Cull time in color below draw time in gray, one column per frame; a line at 60 frames per second."""
    height, left = 32.0, 16.0
    step = _INNER / STRIP
    longest = max([sum(h) for h in history] + [1000 / 60])
    top = max(longest, 1e-6)
    for place, (cull, draw) in enumerate(list(history)[-STRIP:]):
        x = left + (STRIP - min(len(history), STRIP) + place) * step
        a, b = height * cull / top, height * draw / top
        canvas.bar(x, y + height - a - b, step, b, (104, 112, 124))
        canvas.bar(x, y + height - a, step, a, ACCENT)
    line = y + height - height * (1000 / 60) / top
    canvas.bar(left, line, _INNER, 1, FAINT)
    canvas.text(_WIDTH - 16, y - 3, f"{longest:.0f} ms", size=10, color=DIM, align="right")


def help_card(keys: Sequence[Key], scale: float = 1.0) -> Card:
    """The list of keys, in two columns."""
    half = -(-len(keys) // 2)
    canvas = Canvas(760, 62 + 22 * half, scale)
    canvas.text(24, 34, "Keys", size=18)
    canvas.text(
        736, 34, "left drag looks around, right drag slides, the wheel goes forward", size=12, color=DIM, align="right"
    )
    for index, key in enumerate(keys):
        x, y = 24 + 372 * (index // half), 64 + 22 * (index % half)
        canvas.text(x, y, key.shown, color=ACCENT)
        canvas.text(x + 76, y, canvas.fitted(key.text, 290))
    return canvas.card()


def inset_card(pictures: Sequence[tuple[str, NDArray[np.uint8]]], scale: float = 1.0) -> Card:
    """Pictures of overlays with their names above, one below the other."""
    heights = [min(_INNER * p.shape[0] / p.shape[1], 1.5 * _INNER) for _, p in pictures]
    canvas = Canvas(_WIDTH, round(12 + sum(h + 30 for h in heights)), scale)
    y = 12.0
    for (name, picture), height in zip(pictures, heights, strict=True):
        canvas.text(16, y + 14, canvas.fitted(name, _INNER))
        canvas.picture(16, y + 22, height * picture.shape[1] / picture.shape[0], height, picture)
        y += height + 30
    return canvas.card()


def message_card(messages: Sequence[str], scale: float = 1.0) -> Card:
    """Sentences, one per line."""
    width = 24 + max(Canvas(1, 1).length(m) for m in messages)
    canvas = Canvas(round(min(width, 1200)) + 8, 14 + 20 * len(messages), scale)
    for index, message in enumerate(messages):
        canvas.text(16, 24 + 20 * index, canvas.fitted(message, 1180))
    return canvas.card()
