"""How benchmarks print what they found."""

from __future__ import annotations

import sys


def show(title: str, rows: list[tuple[str, str]]) -> None:
    """A small table on the terminal."""
    width = max(len(name) for name, _ in rows)
    sys.stdout.write(f"\n{title}\n" + "".join(f"  {name:<{width}}  {value}\n" for name, value in rows))
