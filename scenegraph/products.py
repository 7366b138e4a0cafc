"""Products that more than one plugin speaks of: what one stage puts into a frame and another one reads.

A product of a single plugin is a class of that plugin. Those here belong to nobody: plugins import no other plugin, so
a stage that reads what a stranger's stage put needs a name that both can import.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray


class LevelOfVisibility:
    """How much detail the occluders in front of each drawable let through (Kristmann 2022): 1 none, -1 all.

    Values are worked out when they are first asked for.

    Parameters
    ----------
    n : int
        Rows of the snapshot.
    hidden : (n,) bool
        Rows that the stage hid: 1.
    rows : (k,) int64
        Rows that are looked at; what is in neither set has -1.
    evaluate : callable
        Gives the k values.
    """

    def __init__(
        self,
        n: int,
        hidden: NDArray[np.bool_],
        rows: NDArray[np.int64],
        evaluate: Callable[[], NDArray[np.float64]],
    ) -> None:
        self._n = n
        self._hidden = hidden
        self.rows = rows
        self._evaluate = evaluate

    @classmethod
    def of(cls, values: ArrayLike) -> LevelOfVisibility:
        """From the (n,) values of all rows."""
        known = np.array(values, np.float64)
        return cls(len(known), np.zeros(len(known), bool), np.arange(len(known)), lambda: known)

    @cached_property
    def values(self) -> NDArray[np.float32]:
        """(n,) level of visibility of each row."""
        out = np.full(self._n, -1.0, np.float32)
        out[self.rows] = self._evaluate()
        out[self._hidden] = 1.0
        return out
