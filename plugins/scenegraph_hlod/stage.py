"""Coherent refinement of an HLOD tree by occlusion queries.

Charalambos, "Coherent hierarchical level-of-detail (HLOD) refinement through hardware occlusion queries". All drawables
that can be merged are one tree of simplified meshes; a frame draws a cut through it. A node is refined until its error
on the screen is at most τ. The paper's idea: a node of which only q of α pixels are visible needs only a part of the
detail, so that the test is ε · (q / α) ≤ τ, with q from the occlusion query that is issued in any case.

Errata and open points of the text, and what we do about them, are told where they are written: α and μ in `measures`,
predictions and traversal in `walk`. Section 4.4 prints τ^q = τ · (q / α), which refines the less visible more; from the
refinement test follows τ^q = τ · (α / q), without bound at q = 0, where nothing is drawn. With `within`, a node has
three meshes, and the coarsest whose error is at most the τ^q of its last answer is drawn.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from scenegraph import Frame, Guarantee, PipelineError, Snapshot, Stage, parameter
from scenegraph.meshes import Hlod, hlod_of

from .cut import HlodCut
from .measures import Alpha, Ints, Measures
from .walk import Predictor, Rules, Walk

#: The four configurations of Table 1.
PRESETS: dict[str, dict[str, Any]] = {
    "CHLOD-eps_q": {"metric": "eps_q", "traversal": "coherent", "predictor": "queue", "trim": False},
    "CHLOD-eps": {"metric": "eps", "traversal": "coherent", "predictor": "queue", "trim": False},
    "SW-eps_q": {"metric": "eps_q", "traversal": "stop_and_wait", "predictor": "queue", "trim": False},
    "SW-eps": {"metric": "eps", "traversal": "stop_and_wait", "predictor": "queue", "trim": False},
}


class HlodRefinement(Stage):
    """Draws a cut through a tree of simplified meshes, coarser where little is visible."""

    name = "hlod"
    writes = ("visible", "standins", HlodCut)
    needs: tuple[str, ...] = ("hlod_tree", "gl")

    preset: Literal["none", "CHLOD-eps_q", "CHLOD-eps", "SW-eps_q", "SW-eps"] = parameter(
        "none", help="a configuration of the paper: sets metric, traversal and predictor"
    )
    metric: Literal["eps_q", "eps"] = parameter(
        "eps_q", help="refine by the error times the visible part of the box, or by the error alone"
    )
    tau: float = parameter(1.0, minimum=0.0, maximum=1000.0, unit="px", help="largest error that is drawn")
    traversal: Literal["coherent", "stop_and_wait", "none"] = parameter(
        "coherent", help="how queries are scheduled; none: no queries, and the metric is eps"
    )
    predictor: Predictor = parameter(
        "temporal",
        help="visible part of a box before its query is answered: as last measured, or by its place in the queue: how "
        "many came before it (queue), or wait before it (rank)",
    )
    alpha: Alpha = parameter("projected", help="pixels of a box: exact, or by a cube of the same volume as printed")
    trim: bool = parameter(True, help="leave out of the picture what was drawn by prediction and is then found hidden")
    within: bool = parameter(False, help="refine within nodes, too: each has three levels of detail")
    chunk: int = parameter(16, minimum=1, maximum=100_000, unit="nodes", help="taken from the queue at a time")

    lag: int = parameter(2, minimum=0, maximum=1000, unit="chunks", help="after which the answer to a query is taken")

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        set_to = PRESETS.get(self.preset, {})
        faults = [
            f"stage 'hlod': {key}={values[key]!r} contradicts preset={self.preset!r}, which sets {value!r}"
            for key, value in set_to.items()
            if key in values and values[key] != value
        ]
        if faults:
            raise PipelineError(faults)
        for key, value in set_to.items():
            setattr(self, key, value)
        # what is needed depends on the parameters, as the guarantee does
        tree = "hlod_tree_levels" if self.within else "hlod_tree"
        self.needs = (tree,) if self.traversal == "none" else (tree, "gl")

    @property
    def guarantee(self) -> Guarantee:
        """Conservative without queries; with them, simplified meshes may hide what they should not."""
        return Guarantee.CONSERVATIVE if self.traversal == "none" else Guarantee.APPROXIMATE

    def open(self, snapshot: Snapshot, progress: object) -> None:
        """Take over the tree."""
        # built by the pipeline, as declared
        self._tree: Hlod = snapshot.prepared("hlod_tree_levels" if self.within else "hlod_tree", hlod_of)

    def skip(self, frame: Frame) -> str | None:
        """Nothing to do without a tree that fits the scene."""
        if not self._tree.triangles.any():
            return "no drawable can be merged into an HLOD tree"
        if self._tree.is_stale(frame.snapshot):
            return "something has moved or changed its color since the HLOD tree was built"
        return None

    def run(self, frame: Frame) -> None:
        """Walk the tree, and draw its nodes instead of the rows."""
        tree = self._tree
        measures = Measures(tree, frame, self.alpha)
        before = frame.previous.find(HlodCut) if frame.previous is not None else None
        if before is not None and before.tree is not tree:
            before = None
        if self.traversal == "none":
            cut = self._without_queries(frame, measures)
        else:
            cut = self._with_queries(frame, measures, before)
        frame.put(cut)
        shown = tree.rows_of(cut.nodes, frame.snapshot.n)
        candidates = tree.covered & frame.visible
        frame.hide(candidates & ~shown)
        frame.replace(np.flatnonzero(candidates & shown), tree.table, chosen=self._meshes(frame, cut))
        frame.count(drawn_nodes=len(cut.nodes), tested=int(np.count_nonzero(cut.visited)))

    def _meshes(self, frame: Frame, cut: HlodCut) -> Ints:
        """(k,) the mesh of each drawn node: its own, or the coarsest within it whose error is at most τ^q."""
        tree, nodes = self._tree, cut.nodes
        if not self.within:
            return nodes
        share = np.nan_to_num(cut.share[nodes], nan=1.0) if self.metric == "eps_q" else np.ones(len(nodes))
        # λ at which ε · μ is τ (section 4.4, corrected); a node that is drawn though hidden may be as coarse as it gets
        with np.errstate(divide="ignore"):
            allowed = frame.view.pixels_error(self.tau / share, tree.boxes[:, nodes])
        fits = tree.level_errors[:, nodes] <= allowed
        fits[0] = True
        level = len(fits) - 1 - np.argmax(fits[::-1], axis=0)
        meshes: Ints = tree.level_mesh[level, nodes]
        return meshes

    def _without_queries(self, frame: Frame, measures: Measures) -> HlodCut:
        tree = self._tree
        nodes = tree.cut((measures.errors <= self.tau) | measures.outside)
        nodes = nodes[~measures.outside[nodes]]
        m = len(tree)
        none = np.zeros(m, bool)
        return HlodCut(
            tree, nodes, measures.errors, np.full(m, np.nan), np.full(m, -1, np.int64), none, none, 0, frame.index
        )

    def _with_queries(self, frame: Frame, measures: Measures, before: HlodCut | None) -> HlodCut:
        rules = Rules(
            threshold=self.tau,
            by_visibility=self.metric == "eps_q",
            # by the error alone nothing is predicted, and only nodes at which refinement stops are asked
            predictor=self.predictor if self.metric == "eps_q" else "queue",
            waits=self.traversal == "stop_and_wait",
            chunk=1 if self.traversal == "stop_and_wait" else self.chunk,
            lag=0 if self.traversal == "stop_and_wait" else self.lag,
            trims=self.trim,
        )
        with frame.device.guard():
            walk = Walk(measures, _Asking(frame, self._tree), rules, before)
            cut = walk.run(frame.index)
        frame.count(
            queries=int(np.count_nonzero(cut.samples >= 0)),
            rarn=walk.rarn,
            trimmed=walk.trimmed,
            scheduled=walk.scheduled,
        )
        return cut


class _Asking:
    """The device, as a walk sees it: nodes are drawn into a depth target, and their boxes asked against it."""

    def __init__(self, frame: Frame, tree: Hlod) -> None:
        self._frame, self._tree = frame, tree
        view = frame.view
        self._target = frame.device.depth_target(view.width, view.height)
        others = frame.visible & ~tree.covered
        # clears the target, too; rows that are no part of the tree hide what is behind them
        frame.device.draw_depth(self._target, view, frame.snapshot, np.flatnonzero(others), frame.level)

    def draw(self, nodes: Ints) -> None:
        self._frame.device.draw_depth_of(self._target, self._frame.view, self._tree.table, nodes)

    def issue(self, nodes: Ints) -> Any:
        return self._frame.device.queries.issue(self._frame.view, self._tree.boxes[:, nodes], self._target)

    def result(self, ticket: Any) -> Ints:
        answers: Ints = self._frame.device.queries.result(ticket)
        return answers
