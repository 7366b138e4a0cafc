"""Text files that announce how much they hold: of one that ends too early, trimesh would take what there is."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import SceneError

_PLY_ELEMENT = re.compile(rb"^element\s+\S+\s+(\d+)", re.MULTILINE)


def refuse_short_text(path: Path, suffix: str) -> None:
    """Check the counts of an OFF or text PLY file against its lines; other files pass.

    Raises
    ------
    SceneError
        There are fewer vertices and faces than announced.
    """
    if suffix == "off":
        wanted, found = _off_counts(path.read_bytes())
    elif suffix == "ply":
        wanted, found = _ply_counts(path.read_bytes())
    else:
        return
    if found < wanted:
        raise SceneError(
            f"{path} is cut short: it announces {wanted} vertices and faces and has {found}; copy or export it again"
        )


def _off_counts(raw: bytes) -> tuple[int, int]:
    lines = [kept for line in raw.splitlines() if (kept := line.split(b"#")[0].strip())]
    if lines and lines[0] in (b"OFF", b"COFF"):
        lines = lines[1:]
    elif lines:
        lines[0] = lines[0].removeprefix(b"C").removeprefix(b"OFF")
    counts = lines[0].split()[:2] if lines else []
    if len(counts) < 2 or not all(c.isdigit() for c in counts):
        return 0, 0
    return sum(map(int, counts)), len(lines) - 1


def _ply_counts(raw: bytes) -> tuple[int, int]:
    header, mark, body = raw.partition(b"end_header")
    if not mark or b"format ascii" not in header:
        return 0, 0
    return sum(map(int, _PLY_ELEMENT.findall(header))), sum(bool(line.strip()) for line in body.splitlines())
