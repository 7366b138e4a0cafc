"""Truth mode: the shown frame against the exact visible set of its view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compare.metrics import snr_db
from ..render.item_buffer import ItemBuffer

if TYPE_CHECKING:
    from ..frame import Frame
    from ..snapshot import Snapshot
    from ..view import View


class Truth:
    """Pixels of each row, drawn in somebody's window; what that takes is made when it is first asked.

    Parameters
    ----------
    snapshot : Snapshot
    renderer : vtkRenderer
    """

    def __init__(self, snapshot: Snapshot, renderer: Any) -> None:
        self._snapshot, self._renderer = snapshot, renderer
        self._item_buffer: ItemBuffer | None = None

    @property
    def render_window(self) -> Any:
        """Where it is drawn, as the item buffer wants to know."""
        return self._renderer.GetRenderWindow()

    def pixels(self, view: View) -> NDArray[np.int64]:
        """(n,) pixels of each row.

        Raises
        ------
        GLError
            The window cannot do it.
        """
        if self._item_buffer is None:
            self._item_buffer = ItemBuffer(self._snapshot, self)  # type: ignore[arg-type]
        return self._item_buffer.render(view).pixels

    def close(self) -> None:
        """Give everything back. Closing twice is allowed."""
        if self._item_buffer is not None:
            self._item_buffer.close()
            self._item_buffer = None


@dataclass(frozen=True)
class Verdict:
    """What truth says about one frame.

    Attributes
    ----------
    rows : (k,) int
        Rows that can be seen and were hidden, most pixels first.
    names : list of str
        Of those rows, the first few.
    pixels : int
        Pixels of all of them.
    visible : int
        Rows that can be seen.
    snr : float
        Of the picture against full detail, in dB; infinite if they are equal.
    """

    rows: NDArray[np.int64]
    names: list[str]
    pixels: int
    visible: int
    snr: float

    @property
    def text(self) -> str:
        """In one line."""
        picture = "equal picture" if self.snr == float("inf") else f"{self.snr:.1f} dB"
        if not len(self.rows):
            return f"no false hides · {self.visible:,} visible · {picture}"
        return f"{len(self.rows):,} false hides · {self.pixels:,} px · {picture}"


def judge(frame: Frame, pixels: NDArray[np.int64], shown: Any, whole: Any) -> Verdict:
    """Compare a frame with the pixels of each row, and its picture with that of everything."""
    rows = np.flatnonzero((pixels > 0) & ~frame.kept())
    rows = rows[np.argsort(-pixels[rows], kind="stable")]
    return Verdict(
        rows,
        frame.snapshot.names(rows[:5]),
        int(pixels[rows].sum()),
        int(np.count_nonzero(pixels)),
        snr_db(shown, whole),
    )
