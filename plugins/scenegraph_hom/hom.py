"""Occlusion maps with frequency analysis.

Kristmann, "Occluder frequency analysis for evaluating the level of visibility of partly occluded objects", TU Wien
2022, on the hierarchical occlusion maps of Zhang, Manocha, Hudson and Hoff (SIGGRAPH 1997): occluders are drawn into
an image, and what lies under an occludee's rectangle says whether it is hidden, and if not, how much detail of it can
be seen.

What is as in the thesis: the overlap test in a pyramid, with the level of eq. 3.1, at most four cells, two descents and
the opacity threshold (`test="pyramid"`); selection by distance; the comparison of depth left out (`depth="distance"`);
coverage by the centers of texels (`strict=False`); the level of visibility of eqs. 3.2 and 3.3, normalized and clamped.

What we changed, and why:

* Coverage is counted in integers. A pyramid of averages loses single open texels to rounding (section 3.3 there).
* By default a texel is closed only if one occluder covers all of it, and its depth is that of the occluder's farthest
  point in it. An occludee's rectangle and depth are rounded outward. Then nothing visible is hidden.
* "No object can be closer to the viewpoint than the occluders" (section 3.2) is false for any occluder with depth, a
  ground plane for one: depths are compared, texel by texel. That also lets occluders hide each other, and makes the
  level of visibility count only what is in front of the occludee.
* By default the rectangle is tested exactly, by a summed-area table and by minima over windows, instead of by the
  pyramid: the opacity threshold is then the part of the rectangle that may be open, and not a guess.
* A rectangle at or behind the near plane is not tested: the drawable stays.
* The level of visibility is worked out from coverage by centers in any case, in a second map, drawn when somebody asks
  for it: strict coverage widens every hole by about a texel, and small ones would seem to show more than large ones.
  Cells of a block that are in front of the occludee in part are counted texel by texel.
* The map is not built when few candidates are left: the thesis names that as the reason of the frames in which it loses
  to frustum culling alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import (
    OUT,
    PARTIAL,
    Batch,
    Frame,
    Guarantee,
    LevelOfVisibility,
    PipelineError,
    Snapshot,
    Stage,
    parameter,
)
from scenegraph.kernels.nearness import NearnessScale, nearness_scale
from scenegraph.kernels.slices import slice_expand

from .catalog import Catalog, Source, make_catalog
from .gl import gl_map
from .outlines import outlines_hidden
from .overlap import hidden_by_cells, hidden_exactly
from .owners import owned_rows_kept
from .products import Footprint, OcclusionMap, map_visibility
from .scan import Drawn, scan_map, texels_per_unit
from .selection import Ranking, select
from .shapes import F64, I64


class Hom(Stage):
    """Hides what lies behind the fused image of some occluders; says how much of the rest can be seen."""

    name = "hom"
    writes = ("visible", OcclusionMap, LevelOfVisibility)
    bound = (
        "with opacity below 1, strict coverage, the exact test and compared depths: at most (1 - opacity) of the "
        "texels that a hidden drawable's rectangle touches were not proven to be closed in front of it"
    )

    width: int = parameter(512, minimum=1, maximum=16384, unit="texels", help="of the map")
    height: int = parameter(256, minimum=1, maximum=16384, unit="texels", help="of the map")
    active: int = parameter(200, minimum=0, maximum=20_000, help="occluders drawn")
    triangles: int = parameter(20_000, minimum=0, maximum=10_000_000, help="budget of triangles for the map")
    occluders: Source = parameter(
        "auto", help="auto: declared occluders, and drawables that none stands for; or only one of the two"
    )
    ranking: Ranking = parameter(
        "size",
        help="which occluders first: largest image, nearest, or half of them by what the last frame left visible",
    )
    reach: float = parameter(0.0, minimum=0.0, unit="world units", help="no occluders farther away; 0 = no limit")
    strict: bool = parameter(True, help="a texel is closed only if wholly covered; otherwise if its center is")
    opacity: float = parameter(1.0, minimum=0.01, maximum=1.0, help="part of a rectangle that must be closed")
    depth: Literal["buffer", "distance"] = parameter(
        "buffer", help="compare depths; or take every occluder to be in front of what is none"
    )
    test: Literal["exact", "pyramid"] = parameter("exact", help="of the rectangle; or of the cells around it")
    outlines: bool = parameter(
        True,
        help="exact test, compared depths and full opacity: where the rectangle is not hidden, try the box's outline",
    )
    descents: int = parameter(2, minimum=0, maximum=16, help="levels that the pyramid test may descend")
    coarsest: bool = parameter(False, help="draw the coarsest level of occluders instead of the finest")
    inner: bool = parameter(
        True, help="draw coarsest levels, shrunk until proved to be inside, for finest ones of many triangles"
    )
    producer: Literal["numpy", "gl"] = parameter(
        "numpy", help="who draws the map: NumPy, or OpenGL (drawables only, centers of texels)"
    )
    least: int = parameter(64, minimum=1, help="skip the stage when fewer candidates are left")

    _catalog: Catalog | None = None

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        if self.producer == "gl":
            if self.occluders == "declared":
                raise PipelineError(
                    ["stage 'hom': producer='gl' draws drawables, not declared occluders; use occluders='meshes'"]
                )
            # what is needed depends on the parameters, as the guarantee does
            self.needs = ("gl",)

    @property
    def guarantee(self) -> Guarantee:
        """Conservative by default; aggressive below full opacity; approximate with any of the thesis' shortcuts."""
        if not self.strict or self.depth != "buffer" or self.coarsest or self.producer == "gl":
            return Guarantee.APPROXIMATE
        if self.opacity == 1.0:
            return Guarantee.CONSERVATIVE
        return Guarantee.AGGRESSIVE if self.test == "exact" else Guarantee.APPROXIMATE

    def open(self, snapshot: Snapshot, progress: Callable[[str, float], None] | None) -> None:
        """Work out what may be an occluder, once per set of rows."""
        source: Source = "meshes" if self.producer == "gl" else self.occluders
        inner = self.inner and self.producer == "numpy"
        self._catalog = snapshot.prepared(
            f"hom {source} {self.triangles} {self.coarsest} {inner} {id(snapshot.occluders)}",
            lambda s: make_catalog(
                s, source=source, largest=self.triangles, coarsest=self.coarsest, inner=inner, progress=progress
            ),
        )

    def close(self) -> None:
        """Let go of the catalog."""
        self._catalog = None

    def skip(self, frame: Frame) -> str | None:
        """Few candidates do not pay for a map."""
        if frame.visible_count < self.least:
            return f"only {frame.visible_count} candidates left"
        if self._catalog is not None and self._catalog.occluders is not frame.snapshot.occluders:
            # another pipeline has given the snapshot other occluders
            self.open(frame.snapshot, None)
        if self._catalog is None or not len(self._catalog):
            return "nothing in the scene can be an occluder"
        return None

    def run(self, frame: Frame) -> None:
        """Select occluders, draw the map, test what is visible."""
        catalog = self._catalog
        assert catalog is not None, "run() before open()"
        items = select(
            frame, catalog, ranking=self.ranking, active=self.active, triangles=self.triangles, reach=self.reach
        )
        scale = _depth_range(frame)
        drawn, item_of = self._draw(frame, catalog, items, scale, strict=self.strict)
        rows, declared = catalog.row[items], catalog.declared[items]
        occlusion = OcclusionMap(
            frame.view,
            drawn.codes,
            scale,
            rows[rows >= 0],
            declared[declared >= 0],
            strict=self.strict,
            redraw=lambda: self._draw(frame, catalog, items, scale, strict=False)[0].codes,
        )
        frame.put(occlusion)
        frame.count(occluders=len(items), occluder_triangles=int(catalog.triangles[items].sum()))

        kept = owned_rows_kept(frame, catalog, items, drawn, item_of, occlusion)
        compared = self.depth == "buffer"
        if not compared:
            kept[occlusion.rows] = True
        before = np.concatenate([[0], np.cumsum(kept)]) if kept.any() else None
        tree = frame.snapshot.tree
        tested: list[tuple[I64, Footprint]] = []

        def classify(batch: Batch) -> NDArray[np.int8]:
            footprint = occlusion.footprint(batch.boxes)
            if self.test == "exact":
                hidden = hidden_exactly(occlusion, footprint, opacity=self.opacity, compared=compared)
            else:
                hidden = hidden_by_cells(
                    occlusion, footprint, opacity=self.opacity, compared=compared, descents=self.descents
                )
            if batch.is_rows:
                if outlines:
                    left = np.flatnonzero(footprint.testable & ~hidden)
                    hidden[left[outlines_hidden(occlusion, frame.snapshot, batch.index[left])]] = True
                hidden &= ~kept[batch.index]
                tested.append((batch.index, footprint))
            elif before is not None:
                hidden &= before[tree.end[batch.index]] == before[tree.first[batch.index]]
            return np.where(hidden, np.int8(OUT), np.int8(PARTIAL))

        outlines = self.outlines and self.test == "exact" and compared and self.opacity == 1.0
        was = frame.visible.copy()
        frame.traverse(classify)
        frame.put(self._visibility(frame, occlusion, was, tested))

    def _draw(
        self, frame: Frame, catalog: Catalog, items: I64, scale: NearnessScale, *, strict: bool
    ) -> tuple[Drawn, I64]:
        """The map, and the item of each instance in it."""
        size = self.width, self.height
        if self.producer == "gl":
            rows = catalog.row[items]
            drawn = gl_map(frame, rows, size=size, scale=scale, strict=strict, coarsest=self.coarsest)
            return drawn, np.zeros(0, np.int64)
        table, mesh = catalog.table, catalog.mesh[items]
        shapes = slice_expand(table.mesh_first[mesh], table.mesh_first[mesh + 1])
        item_of = np.repeat(np.arange(len(items)), np.diff(table.mesh_first)[mesh])
        matrices = frame.snapshot.transforms[catalog.transform[items]]
        if strict:
            # a shape without room for a whole texel cannot close one
            room = texels_per_unit(frame, catalog.packed(frame.snapshot)[items], matrices, size)[item_of]
            large = ~(2 * room * table.radius[shapes] < 1.0)
            shapes, item_of = shapes[large], item_of[large]
        # one can be in a room, but nobody promises anything about the inside of a declared occluder
        hollow = catalog.row[items][item_of] >= 0
        return scan_map(
            frame.view, table, shapes, matrices[item_of], hollow, size=size, scale=scale, strict=strict
        ), item_of

    def _visibility(
        self, frame: Frame, occlusion: OcclusionMap, was: NDArray[np.bool_], tested: list[tuple[I64, Footprint]]
    ) -> LevelOfVisibility:
        """Analyze what is still visible; in the thesis' way of comparing depths, occluders are seen in full."""
        rows = np.concatenate([np.zeros(0, np.int64), *(index for index, _ in tested)])
        testable = np.concatenate([np.zeros(0, bool), *(f.testable for _, f in tested)])
        looked_at = testable & frame.visible[rows]
        if self.depth == "distance":
            looked_at[np.isin(rows, occlusion.rows)] = False

        def evaluate() -> F64:
            texels = np.concatenate([np.zeros((4, 0), np.int64), *(f.texels for _, f in tested)], axis=1)[:, looked_at]
            codes = np.concatenate([np.zeros(0, np.uint16), *(f.codes for _, f in tested)])[looked_at]
            return map_visibility(occlusion.by_centers, texels, codes if self.depth == "buffer" else None)

        return LevelOfVisibility(frame.snapshot.n, was & ~frame.visible, rows[looked_at], evaluate)


def _depth_range(frame: Frame) -> NearnessScale:
    """A scale from the nearest to the farthest of what is visible; single precision is enough for choosing one."""
    view, snapshot = frame.view, frame.snapshot
    forward = view.forward
    nearest_of = np.concatenate([forward, -np.abs(forward), [-forward @ view.relative_eye(snapshot.origin), 0.0]])
    with np.errstate(invalid="ignore", over="ignore"):
        nearest = snapshot.packed.take(frame.candidates(), axis=0) @ nearest_of.astype(np.float32)
    nearest = nearest[np.isfinite(nearest)]
    low, high = (float(nearest.min()), float(nearest.max())) if len(nearest) else (view.near, view.far)
    if view.is_parallel:
        size = max(abs(low), abs(high), float(np.abs(view.window).max()), snapshot.radius)
        return nearness_scale(low, high, parallel=True, tolerance=1e-8 * size)
    low = max(low, view.near)
    return nearness_scale(low, max(high, low), parallel=False)
