"""Edge collapse by `fast_simplification`, from one thread at a time: it keeps the mesh in global variables."""

from __future__ import annotations

from threading import Lock
from typing import Any

_ALONE = Lock()


def collapse(points: Any, faces: Any, **options: Any) -> Any:
    """What `fast_simplification.simplify` gives for the same arguments."""
    # slow to import, and listing the stages does not need it
    from fast_simplification import simplify

    with _ALONE:
        return simplify(points, faces, **options)


def replay(points: Any, faces: Any, collapses: Any) -> Any:
    """What `fast_simplification.replay_simplification` gives for the same arguments."""
    from fast_simplification import replay_simplification

    with _ALONE:
        return replay_simplification(points, faces, collapses)
