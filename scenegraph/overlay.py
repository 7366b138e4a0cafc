"""Overlay: what a plugin lets the viewer show about a frame, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .frame import Frame

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Lines:
    """Straight lines in the world.

    Attributes
    ----------
    ends : (k, 2, 3) float64
        World coordinates of both ends.
    color : 3 floats in 0..1
    width : float
        Pixels.
    """

    ends: NDArray[np.float64]
    color: Color = (1.0, 0.8, 0.2)
    width: float = 1.5


@dataclass(frozen=True)
class Faces:
    """Translucent triangles in the world.

    Attributes
    ----------
    points : (v, 3) float64
        World coordinates.
    triangles : (f, 3) int
        Indices of points.
    color : 3 floats in 0..1
    opacity : float
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.integer]
    color: Color = (1.0, 0.8, 0.2)
    opacity: float = 0.2


class Overlay:
    """One way of looking at a frame. Subclass it, name it, and override what it shows.

    Class attributes
    ----------------
    name : str
        Unique; shown to users.
    stage : str
        Offered only where a stage of this name is in the pipeline; everywhere if empty.
    key : str
        The key that switches it alone, as X and VTK name it; without effect if the viewer itself or an earlier overlay
        has it already. One key cycles through all colorings, and another switches all that draws, in any case.
    """

    name: ClassVar[str] = ""
    stage: ClassVar[str] = ""
    key: ClassVar[str] = ""

    #: The row that the user has picked, or None; set by the viewer before it asks for anything.
    picked: int | None = None

    @classmethod
    def summary(cls) -> str:
        """First line of the docstring."""
        return (cls.__doc__ or "").strip().partition("\n")[0]

    @classmethod
    def is_coloring(cls) -> bool:
        """Whether it says which color rows have; at most one such is shown at a time."""
        return cls.colors is not Overlay.colors

    def colors(self, frame: Frame) -> NDArray[np.floating] | None:
        """(n, 4) color of each row in 0..1; rows with opacity 0 are not drawn. None leaves the picture as it is."""
        return None

    def legend(self, frame: Frame) -> list[tuple[str, Color]]:
        """What the colors mean."""
        return []

    def lines(self, frame: Frame) -> list[Lines]:
        """Lines drawn into the scene."""
        return []

    def faces(self, frame: Frame) -> list[Faces]:
        """Faces drawn into the scene."""
        return []

    def inset(self, frame: Frame) -> NDArray[np.uint8] | None:
        """(h, w, 3) picture shown in a corner with what is drawn, top row first; None for no picture."""
        return None
