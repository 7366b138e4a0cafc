"""How benchmarks time what they measure, and print what they found."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any


def show(title: str, rows: list[tuple[str, str]]) -> None:
    """A small table on the terminal."""
    width = max(len(name) for name, _ in rows)
    sys.stdout.write(f"\n{title}\n" + "".join(f"  {name:<{width}}  {value}\n" for name, value in rows))


def best_ms(work: Callable[[], Any], repeats: int = 15) -> float:
    """The best of several times."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return best * 1e3
