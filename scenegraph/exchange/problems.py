"""What was odd about an input but did not stop it: counted by kind, with the names of the first few."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator

from ..errors import SceneError

#: How many names a sentence lists before it says "and N more".
NAMED = 5

NOT_FINITE = "vertices that are not finite, objects kept and always drawn"
MISSING_VERTICES = "faces dropped because they name vertices that do not exist"
NO_FACES = "meshes without faces left out"
NO_TRIANGLES = "points, lines or volumes left out, only triangles are drawn"
SINGULAR = "transforms that flatten what is below them or are not finite, kept"
PROJECTIVE = "transforms whose last row is not 0 0 0 1, objects left out"
HUGE = "coordinates so large that float64 has no decimals left, kept"
NO_TEXTURE = "textures that cannot be read, objects kept with their base color"
NO_UV = "textures without usable texture coordinates, objects kept with their base color"
UNPLACED = "geometry that no node places, left out"


class Problems:
    """Collects remarks; `sentences()` gives one sentence per kind."""

    def __init__(self) -> None:
        self._kinds: dict[str, list[str]] = {}

    def note(self, kind: str, name: str, detail: str = "") -> None:
        """Remember that `name` has the problem `kind`; `detail` is shown in parentheses."""
        item = f"{name!r} ({detail})" if detail else repr(name)
        items = self._kinds.setdefault(kind, [])
        if item not in items:
            items.append(item)

    def say(self, sentence: str) -> None:
        """Remember a sentence that stands alone."""
        self._kinds.setdefault(sentence, [])

    def sentences(self) -> list[str]:
        """One sentence per kind, in the order in which they turned up."""
        out = []
        for kind, items in self._kinds.items():
            more = f" and {len(items) - NAMED} more" if len(items) > NAMED else ""
            out.append(f"{kind}: {', '.join(items[:NAMED])}{more}" if items else kind)
        return out

    def empty(self, label: str, cure: str) -> SceneError:
        """The error for an input in which nothing is left to draw; it repeats what was left out."""
        reasons = "; ".join(self.sentences())
        return SceneError(f"{label} has no triangles to draw{f' ({reasons})' if reasons else ''}; {cure}")


class _Listener(logging.Handler):
    def __init__(self, problems: Problems) -> None:
        super().__init__(logging.WARNING)
        self.problems = problems

    def emit(self, record: logging.LogRecord) -> None:
        self.problems.say(f"trimesh: {record.getMessage()}")


@contextlib.contextmanager
def quiet_trimesh(problems: Problems) -> Iterator[None]:
    """Turn what trimesh logs into problems, and keep its warnings from the user."""
    logger = logging.getLogger("trimesh")
    listener = _Listener(problems)
    propagate = logger.propagate
    logger.addHandler(listener)
    logger.propagate = False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.removeHandler(listener)
        logger.propagate = propagate
