"""Shadow-frustum culling.

Papaioannou, Gaitatzes & Christopoulos, "Efficient occlusion culling using solid occluders", WSCG 2006, extending
Hudson et al., "Accelerated occlusion culling using shadow frusta", SCG 1997: what lies wholly inside the shadow that
a convex occluder casts from the eye cannot be seen. Few occluders, the best of each frame, are active. What differs
from the print is said where it is written: scores in `ranking`, silhouettes and caps in
`scenegraph.kernels.silhouettes`.

Why no two coincident occluders can make their owners vanish: only what is strictly behind an occluder is hidden, so
along every ray the nearest thing stays, as long as occluders lie inside what they stand for.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from scenegraph import Frame, Guarantee, Snapshot, Stage, parameter

from .catalog import Catalog
from .choice import by_margin, by_solid_angle, covered
from .frusta import FAULTS, Bools, Floats, Ints, ShadowFrusta, Shapes, Topology
from .holes import hole_rows
from .ranking import Scores
from .verdict import Verdict

#: Up to so many rows are asked at once; above, the tree pays for itself (tests/bench/bench_shadow.py).
FLAT_LIMIT = 12_000

#: Occluders looked at for each that is used: most of the best-ranked ones stand in the shadow of better ones.
POOL = 4

#: A solid with more front faces than these ends at a single cap: each plane costs a product per box.
MOST_FACES = 4


class Shadow(Stage):
    """Hides what lies in the shadow of a single convex occluder."""

    name = "shadow"
    guarantee = Guarantee.CONSERVATIVE
    writes = ("visible", ShadowFrusta)
    needs = ("occluders",)

    occluders: Literal["planar", "solid", "both"] = parameter("both", help="which kind of occluders is used")
    active: int = parameter(15, minimum=0, maximum=1000, help="most occluders used in a view; 0 = off")
    ranking: Literal["area_angle", "printed", "solid_angle", "marginal"] = parameter(
        "area_angle", help="how the active occluders are chosen"
    )
    reselect: int = parameter(1, minimum=1, maximum=1000, unit="frames", help="rank all occluders anew so often")
    cap: Literal["faces", "depth"] = parameter(
        "faces", help="a solid's shadow begins behind its front faces, or behind its whole silhouette"
    )

    def open(self, snapshot: Snapshot, progress: object) -> None:
        """Measure the occluders."""
        self._catalog = Catalog(snapshot, self.occluders, drop_contained=self.cap == "faces")
        self._topology = Topology(snapshot.occluders)
        self._scores: Scores | None = None
        self._least = np.inf

    def skip(self, frame: Frame) -> str | None:
        """Nothing to do without occluders."""
        if not self.active:
            return "active = 0"
        if len(self._catalog):
            return None
        return f"the scene has no {'' if self.occluders == 'both' else self.occluders + ' '}occluders"

    def run(self, frame: Frame) -> None:
        """Choose the occluders, make their frusta, and walk the hierarchy."""
        if self._catalog.table is not frame.snapshot.occluders:
            # another pipeline has given the snapshot other occluders
            self.open(frame.snapshot, None)
        self._catalog.refresh()
        frusta = self._frusta(frame)
        frame.put(frusta)
        if len(frusta):
            verdict = Verdict(frame.snapshot, frusta)
            frame.traverse(verdict, flat=frame.visible_count <= FLAT_LIMIT)
            frame.count(undecided=verdict.undecided)

    def close(self) -> None:
        """Forget the occluders."""
        del self._catalog, self._topology, self._scores

    def _frusta(self, frame: Frame) -> ShadowFrusta:
        window = frame.view.planes(frame.view.eye)
        before = frame.previous.find(ShadowFrusta) if self.reselect > 1 and frame.previous is not None else None
        fits = before is not None and before.table is frame.snapshot.occluders
        if before is not None and fits and 0 < frame.index - before.chosen_at < self.reselect:
            frusta = self._chosen(frame, window, before.pool, before.chosen_at)
            # a view that has turned away from what was chosen for another one gets a choice of its own at once
            if len(frusta) > len(before) // 2:
                return frusta
        return self._chosen(frame, window, self._pool(frame, window), frame.index)

    def _pool(self, frame: Frame, window: Floats) -> Ints:
        """The occluders to choose from, by rank."""
        view, cheap = frame.view, self.ranking in ("area_angle", "printed")
        if self._scores is None or not self._scores.fits(self._catalog, view):
            self._scores = Scores(self._catalog, view, self.ranking if cheap else "image")
        already = self._scores.scored
        pool, self._least = self._scores.best(window, POOL * self.active, self._least)
        frame.count(scored=self._scores.scored - already)
        return pool

    def _chosen(self, frame: Frame, window: Floats, pool: Ints, chosen_at: int) -> ShadowFrusta:
        view, table = frame.view, frame.snapshot.occluders
        if not len(pool):
            frame.count(active=0, unusable=self._catalog.unusable)
            none = np.zeros((0, 1, 8))
            return ShadowFrusta(table, pool, none, none, pool, np.asarray(view.eye), pool, chosen_at)
        shapes = Shapes(table, self._topology, self._catalog.warp, pool, view)
        rows, faults = shapes.rows(window, MOST_FACES if self.cap == "faces" else 0)
        good: Bools = np.asarray(~np.logical_or.reduce(faults, axis=0))
        if self._topology.any_outside_only and table.outside_only.take(pool).any():
            good &= table.holds_for(view, frame.snapshot.boxes).take(pool)
        whole = good if not table.holes else good & ~np.isin(pool, [o for o, _, _ in table.holes])
        idle = covered(shapes, rows, whole, self.active)
        order = self._order(shapes, rows, good & ~idle)[: self.active]
        ids, rows = pool.take(order), rows.take(order, axis=0)
        holes, hole_of = hole_rows(table, view, ids, rows) if table.holes else (rows[:0], order[:0])
        frame.count(
            active=len(order),
            covered=int(np.count_nonzero(idle)),
            unusable=self._catalog.unusable,
            **dict(zip(FAULTS, np.add.reduce(faults, axis=1).tolist(), strict=True)),
        )
        if self.reselect > 1 and chosen_at == frame.index:
            # what was chosen, and a few more in case the view turns away from some
            pool = np.concatenate([ids, pool[~np.isin(pool, ids)]])[: self.active + self.active // 2]
        return ShadowFrusta(table, ids, rows, holes, hole_of, np.asarray(view.eye), pool, chosen_at)

    def _order(self, shapes: Shapes, rows: Floats, good: Bools) -> Ints:
        if self.ranking == "solid_angle":
            return by_solid_angle(shapes, good)
        if self.ranking == "marginal":
            return by_margin(rows, good, shapes.view, self.active)
        return good.nonzero()[0]
