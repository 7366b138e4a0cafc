"""A translucent card with text, bars and sliders on it, drawn with Pillow: quiet, and legible on any scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..overlay import Color

GROUND = (22, 24, 28, 205)
TEXT = (232, 232, 228)
DIM = (156, 160, 166)
FAINT = (70, 74, 82)
GOOD = (120, 200, 150)
BAD = (240, 110, 96)
ACCENT = (236, 176, 84)
#: Characters that Pillow's own font has, beside ASCII.
_OWN = frozenset("·…")


@dataclass(frozen=True)
class Spot:
    """A part of a card that answers to the mouse.

    Attributes
    ----------
    x, y, width, height : int
        Pixels from the card's upper left corner.
    what : tuple of str
        What it stands for.
    """

    x: int
    y: int
    width: int
    height: int
    what: tuple[str, ...]

    def share(self, x: float) -> float:
        """How far along the spot a point is, 0 to 1."""
        return min(max((x - self.x) / max(self.width, 1), 0.0), 1.0)


@dataclass
class Card:
    """A finished picture.

    Attributes
    ----------
    image : (h, w, 4) uint8
        Top row first.
    spots : list of Spot
    """

    image: NDArray[np.uint8]
    spots: list[Spot] = field(default_factory=list)

    def spot(self, x: float, y: float) -> Spot | None:
        """The spot at a point, in pixels from the upper left corner."""
        for s in self.spots:
            if s.x - 4 <= x <= s.x + s.width + 4 and s.y <= y < s.y + s.height:
                return s
        return None


@cache
def font(size: int, plain: bool = True) -> Any:
    """Pillow's own font; for other than plain characters the DejaVu that comes with matplotlib, which is not loaded."""
    if not plain:
        spec = find_spec("matplotlib")
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            path = Path(folder) / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
            if path.exists():
                return ImageFont.truetype(str(path), size - 1)
    return ImageFont.load_default(size=size)


def font_for(text: str, size: int) -> Any:
    """A font that has all characters of a text, as far as there is one."""
    return font(size, all(c.isascii() or c in _OWN for c in text))


def rgb(color: Color) -> tuple[int, int, int]:
    """Bytes."""
    return (round(color[0] * 255), round(color[1] * 255), round(color[2] * 255))


class Canvas:
    """A card in the making; coordinates are pixels from its upper left corner.

    Parameters
    ----------
    width, height : int
    scale : float
        Of everything: 2 on screens with small pixels.
    """

    def __init__(self, width: int, height: int, scale: float = 1.0) -> None:
        self.scale = scale
        self.width, self.height = width, height
        self._image = Image.new("RGBA", (round(width * scale), round(height * scale)), (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._image)
        self.spots: list[Spot] = []
        corner = round(8 * scale)
        self._draw.rounded_rectangle((0, 0, self._image.width - 1, self._image.height - 1), corner, fill=GROUND)

    def text(self, x: float, y: float, text: str, *, size: int = 13, color: Any = TEXT, align: str = "left") -> None:
        """Write a line; `align` says which end of it is at `x`."""
        anchor = {"left": "ls", "right": "rs", "middle": "ms"}[align]
        made = font_for(text, round(size * self.scale))
        self._draw.text((x * self.scale, y * self.scale), text, font=made, fill=(*color, 255), anchor=anchor)

    def fitted(self, text: str, width: float, size: int = 13) -> str:
        """The text, with an ellipsis at its end if it is too long."""
        made = font_for(text, size)
        if made.getlength(text) <= width:
            return text
        while text and made.getlength(text + "…") > width:
            text = text[:-1]
        return text + "…"

    @staticmethod
    def length(text: str, size: int = 13) -> float:
        """Pixels that a line takes, unscaled."""
        return float(font_for(text, size).getlength(text))

    def bar(self, x: float, y: float, width: float, height: float, color: Any) -> None:
        """Fill a rectangle."""
        s = self.scale
        if width > 0 and height > 0:
            box = (x * s, y * s, max((x + width) * s - 1, x * s), max((y + height) * s - 1, y * s))
            self._draw.rectangle(box, fill=(*color, 255))

    def knob(self, x: float, y: float, radius: float, color: Any) -> None:
        """Fill a circle."""
        s = self.scale
        box = ((x - radius) * s, (y - radius) * s, (x + radius) * s, (y + radius) * s)
        self._draw.ellipse(box, fill=(*color, 255))

    def picture(self, x: float, y: float, width: float, height: float, pixels: NDArray[np.uint8]) -> None:
        """Fill a rectangle with a picture (h, w, 3), top row first; magnified pixels stay squares."""
        size = (max(round(width * self.scale), 1), max(round(height * self.scale), 1))
        larger = size[0] >= pixels.shape[1]
        how = Image.Resampling.NEAREST if larger else Image.Resampling.BOX
        made = Image.fromarray(np.ascontiguousarray(pixels)).convert("RGBA").resize(size, how)
        self._image.paste(made, (round(x * self.scale), round(y * self.scale)))

    def mark(self, x: float, y: float, width: float, height: float, *what: str) -> None:
        """Make a part answer to the mouse."""
        s = self.scale
        self.spots.append(Spot(round(x * s), round(y * s), round(width * s), round(height * s), what))

    def card(self) -> Card:
        """The finished card."""
        return Card(np.asarray(self._image), self.spots)
