"""Numbers as people read them."""

from __future__ import annotations

import math


def short(value: float) -> str:
    """Write a number as briefly as a reader needs it: 0.042, 3.1, 27, 12345, 123 k, 3.4 M."""
    size = abs(value)
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞" if value > 0 else "−∞"
    if size >= 999_500:
        return f"{value / 1e6:.3g} M"
    if size >= 99_950:
        return f"{value / 1e3:.3g} k"
    if size >= 100 or value == int(value):
        return f"{value:.0f}"
    return f"{value:.2g}" if size < 10 else f"{value:.3g}"


def counted(number: int, noun: str) -> str:
    """Write a number of things."""
    return f"{short(number)} {noun}" + ("" if number == 1 else "s")


def duration(ms: float) -> str:
    """Write milliseconds, or seconds where there are many."""
    return f"{short(ms / 1e3)} s" if ms >= 10_000 else f"{short(ms)} ms"


def size(count: float) -> str:
    """Write a number of bytes."""
    for unit in ("bytes", "KiB", "MiB"):
        if count < 1024:
            return f"{short(round(count, 1))} {unit}"
        count /= 1024
    return f"{short(count)} GiB"


def percent(value: float) -> str:
    """Write a share as a percentage."""
    return f"{short(100 * value)} %"


def decibel(value: float) -> str:
    """Write decibels with one decimal."""
    return f"{value:.1f}" if math.isfinite(value) else short(value)
