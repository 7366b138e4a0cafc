"""Occlusion queries over the bounding hierarchy.

Stop and wait, and coherent hierarchical culling: Bittner, Wimmer, Piringer and Purgathofer, "Coherent hierarchical
culling: hardware occlusion queries made useful", Eurographics 2004 (in Charalambos' paper on HLOD refinement:
algorithms 1 to 4). CHC++: Mattausch, Bittner and Wimmer, "CHC++: coherent hierarchical culling revisited",
Eurographics 2008. Batched: two-phase culling as engines do it on the GPU (Haar and Aaltonen, SIGGRAPH 2015).

What we changed, and why:

* VTK draws when the stage has ended. So the stage draws the depth of what it finds visible into a buffer of its own,
  and a drawable whose answer comes late is not drawn in vain: the papers draw what was visible in the last frame
  before its answer is known.
* Then all that was drawn is asked about once more, in one draw, against the depth of everything (`retest`). The
  visible set no longer depends on the order of asking, nor on when answers came: the three traversals end on the same.
* Everything hidden was asked about in this frame, against the depth of drawables of this frame: history decides what is
  asked first and what is drawn without asking, and hides nothing. A result of the frame before is used for nothing that
  was outside the view frustum then.
* The moment at which a visible drawable is asked again (CHC++: random) follows from its row and the frame's number.
* The leaves of the hierarchy are drawables, not groups of them; the box of a leaf node is that of a few drawables.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, Guarantee, Snapshot, Stage, parameter

from .asking import Asking
from .batched import batched
from .coherent import Schedule, coherent, tight_nodes
from .history import QueryHistory, row_phases
from .stop_and_wait import stop_and_wait

Traversal = Literal["batched", "coherent", "stop_and_wait"]


class Query(Stage):
    """Hides what occlusion queries find hidden behind the drawables that are visible."""

    name = "query"
    needs = ("gl",)
    writes = ("visible", QueryHistory)

    traversal: Traversal = parameter(
        "batched", help="batched: all boxes at once; coherent: CHC and CHC++; stop_and_wait: front to back, one by one"
    )
    threshold: int = parameter(0, minimum=0, unit="samples", help="hide what has no more samples than this")
    period: int = parameter(
        5,
        minimum=1,
        maximum=1000,
        unit="frames",
        help="what was visible is asked about every so many frames; 1 = always",
    )
    schedule: Literal["2008", "2004"] = parameter(
        "2008", help="coherent: as in CHC++ (2008), or as in CHC (2004), which knows no batch and no period"
    )
    batch: int = parameter(80, minimum=1, maximum=10_000, help="CHC++: previously hidden nodes asked about together")
    latency: int = parameter(
        8,
        minimum=0,
        unit="nodes",
        help="coherent: go on with so many before an answer is fetched; 0: when it is there, which no run can replay",
    )
    retest: bool = parameter(
        True, help="not batched: ask about what is kept once more when all depth is known; batched always does"
    )
    supersample: int = parameter(1, minimum=1, maximum=8, unit="samples", help="of the query buffer per pixel and axis")
    margin: float = parameter(
        1.0,
        minimum=0.0,
        maximum=100.0,
        unit="samples",
        help="by which boxes are grown on the screen; from 1/2 on no box falls between samples",
    )
    least: int = parameter(64, minimum=1, help="skip the stage when fewer candidates are left")

    _phases: NDArray[np.int64] | None = None
    _tight: tuple[int, NDArray[np.bool_]] | None = None

    @property
    def guarantee(self) -> Guarantee:
        """Conservative at the resolution of the query buffer with threshold 0; aggressive above."""
        return Guarantee.AGGRESSIVE if self.threshold else Guarantee.CONSERVATIVE

    @property
    def bound(self) -> str:  # type: ignore[override]
        """For a threshold."""
        return f"a hidden drawable has at most {self.threshold} samples of the query buffer" if self.threshold else ""

    @property
    def asks_every_frame(self) -> bool:
        """Whether what was visible is asked about in every frame."""
        return self.period == 1 or self.traversal == "stop_and_wait" or self.is_of_2004

    @property
    def is_of_2004(self) -> bool:
        """CHC as it was published first."""
        return self.traversal == "coherent" and self.schedule == "2004"

    def open(self, snapshot: Snapshot, progress: object) -> None:
        """Work out in which frames each row is due."""
        self._phases = None if self.asks_every_frame else row_phases(snapshot.n, self.period)

    def close(self) -> None:
        """Forget."""
        self._phases, self._tight = None, None

    def skip(self, frame: Frame) -> str | None:
        """Few candidates do not pay, and a buffer may be too large."""
        if frame.visible_count < self.least:
            return f"only {frame.visible_count} candidates left"
        width, height = frame.view.width * self.supersample, frame.view.height * self.supersample
        if max(width, height) > frame.device.largest_target:
            return f"a query buffer of {width}x{height} samples is too large for this OpenGL"
        return None

    def run(self, frame: Frame) -> None:
        """Draw, ask, hide."""
        due = np.ones(frame.snapshot.n, bool) if self._phases is None else self._phases == frame.index % self.period
        with frame.device.guard():
            asking = Asking(frame, threshold=self.threshold, supersample=self.supersample, margin=self.margin, due=due)
            self._traversal(frame.snapshot)(asking)
            if self.retest or self.traversal == "batched":
                asking.ask_again()
            asking.finish()

    def _traversal(self, snapshot: Snapshot) -> Callable[[Asking], None]:
        if self.traversal == "batched":
            return batched
        if self.traversal == "stop_and_wait":
            return stop_and_wait
        plus = not self.is_of_2004
        tight = self._tight_nodes(snapshot) if plus else np.zeros(len(snapshot.tree), bool)
        schedule = Schedule(self.batch if plus else 1, multi=plus, ahead=plus, tight=tight, latency=self.latency)
        return lambda asking: coherent(asking, schedule, retest=self.retest)

    def _tight_nodes(self, snapshot: Snapshot) -> NDArray[np.bool_]:
        if self._tight is None or self._tight[0] != snapshot.version:
            self._tight = snapshot.version, tight_nodes(snapshot)
        return self._tight[1]
