"""The panel of parameters: a slider, switch or list for each, made from its declaration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..stage import Parameter, Stage
from .canvas import DIM, FAINT, TEXT, Canvas, Card, rgb
from .colorings import stage_color

_WIDTH = 280
_LEFT, _RIGHT = 18, _WIDTH - 18


def bounds(p: Parameter) -> tuple[float, float]:
    """Ends of a slider; a missing bound is guessed from the default."""
    low = p.minimum if p.minimum is not None else min(0.0, 10.0 * float(p.default))
    high = p.maximum if p.maximum is not None else max(1.0, 10.0 * abs(float(p.default)))
    return float(low), float(high)


def is_logarithmic(p: Parameter) -> bool:
    """Whether most of a linear slider would be far from what anybody sets."""
    low, high = bounds(p)
    return low >= 0 and high - low > 200


def share_of(p: Parameter, value: Any) -> float:
    """Where on its slider a value is, 0 to 1."""
    if p.choices:
        return p.choices.index(value) / max(len(p.choices) - 1, 1)
    if p.type is bool:
        return float(value)
    low, high = bounds(p)
    if is_logarithmic(p):
        return math.log1p(value - low) / math.log1p(high - low)
    return (float(value) - low) / (high - low) if high > low else 0.0


def value_at(p: Parameter, share: float) -> Any:
    """The value at a place of the slider, a round one where there are many."""
    share = min(max(share, 0.0), 1.0)
    if p.choices:
        return p.choices[round(share * (len(p.choices) - 1))]
    if p.type is bool:
        return share >= 0.5
    low, high = bounds(p)
    if is_logarithmic(p):
        value = low + math.expm1(share * math.log1p(high - low))
    else:
        value = low + share * (high - low)
    if p.type is int:
        return int(min(max(round(value), math.ceil(low)), math.floor(high)))
    step = 10.0 ** (math.floor(math.log10(max(abs(value), (high - low) * 1e-3))) - 2)
    return float(min(max(round(value / step) * step, low), high))


def shown(p: Parameter, value: Any) -> str:
    """A value with its unit."""
    text = f"{value:.4g}" if isinstance(value, float) else ("on" if value else "off") if p.type is bool else str(value)
    return f"{text} {p.unit}".strip()


def panel_card(stages: Sequence[Stage], scale: float = 1.0) -> Card:
    """One block per stage that has parameters."""
    blocks = [(index, stage) for index, stage in enumerate(stages) if stage.parameters()]
    rows = sum(len(stage.parameters()) for _, stage in blocks)
    canvas = Canvas(_WIDTH, max(24 + 30 * len(blocks) + 40 * rows, 48), scale)
    y = 12.0
    if not blocks:
        canvas.text(_LEFT, 29, "no stage here has parameters", color=DIM)
    for index, stage in blocks:
        y += 20
        canvas.knob(_LEFT + 3, y - 4, 4, rgb(stage_color(index)))
        canvas.text(_LEFT + 14, y, stage.name)
        y += 10
        for p in stage.parameters().values():
            value = getattr(stage, p.name)
            canvas.text(_LEFT, y + 14, p.name, size=12, color=DIM)
            canvas.text(_RIGHT, y + 14, canvas.fitted(shown(p, value), 150, 12), size=12, color=TEXT, align="right")
            length = _RIGHT - _LEFT
            at = _LEFT + length * share_of(p, value)
            canvas.bar(_LEFT, y + 24, length, 2, FAINT)
            canvas.bar(_LEFT, y + 24, at - _LEFT, 2, rgb(stage_color(index)))
            canvas.knob(at, y + 25, 5, TEXT)
            canvas.mark(_LEFT, y + 14, length, 22, "parameter", stage.name, p.name)
            y += 40
    return canvas.card()
