"""Table 1 and Figures 2 to 10 of Charalambos, measured here.

The paper's scenes are Stanford models of low, middle and high depth complexity; which, and along which paths, is not
told. `inspection` has three such scenes with paths of 500 views: scans if a folder of them is given, figures otherwise.
Drawn nodes and refinements of drawn nodes can be compared as numbers of nodes of 2000 triangles; frames per second are
those of another machine, and stand there for their ratios.

Beside the paper's four configurations stands ours: μ̂ is what was measured last, and what is found hidden is trimmed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, Lines
from scenegraph.compare.replication import Cell, Laboratory, Picture, Plot, Replication, likeness
from scenegraph.render.window import OffscreenWindow
from scenegraph.viewer.ghosts import Gizmos

from .cut import HlodCut
from .overlays import HlodBoxes, box_edges

#: Frames per second, drawn nodes and RARN of Table 1.
_PAPER: dict[str, dict[str, tuple[float, float, float | None]]] = {
    "low": {
        "CHLOD-eps_q": (72.3, 94.82, 0.85),
        "CHLOD-eps": (61.57, 110.69, None),
        "SW-eps_q": (53.23, 75.71, None),
        "SW-eps": (40.39, 107.24, None),
    },
    "middle": {
        "CHLOD-eps_q": (40.56, 166.54, 1.97),
        "CHLOD-eps": (34.99, 193.92, None),
        "SW-eps_q": (28.48, 141.25, None),
        "SW-eps": (22.24, 180.56, None),
    },
    "high": {
        "CHLOD-eps_q": (62.49, 159.32, 2.95),
        "CHLOD-eps": (47.69, 200.9, None),
        "SW-eps_q": (43.27, 103.8, None),
        "SW-eps": (28.19, 199.48, None),
    },
}
_SCENES = {"low": "scene 1 (low)", "middle": "scene 2 (middle)", "high": "scene 3 (high)"}
#: Figures of frame rates and of drawn nodes, and of pictures.
_FIGURES = {"low": (2, 3, 8), "middle": (4, 5, 9), "high": (6, 7, 10)}
#: The other reading of the place in the queue.
_RANK = {"CHLOD-eps_q, rank": "hlod(predictor=rank, trim=False)"}
_OURS = {"temporal": "hlod(trim=False)", "temporal, trimmed": "hlod"}
_PIPELINES = {name: f"hlod(preset='{name}')" for name in _PAPER["low"]} | _RANK | _OURS
#: Every so many-th frame is drawn, for the frame rate; all are culled, for the rest.
_EVERY = 5
#: Where along the path pictures are compared, and which of them is shown: an extreme close-up.
_PICTURES = (0.05, 0.16, 0.36, 0.46, 0.58, 0.72, 0.84, 0.95)
_SHOWN = 6


def replicate(laboratory: Laboratory) -> Replication:
    """Play the three scenes, and lay the numbers beside the paper's."""
    found = Replication(
        "charalambos",
        "Coherent Hierarchical Level-of-Detail (HLOD) Refinement Through Hardware Occlusion Queries (Charalambos)",
    )
    for depth in _PAPER:
        _scene(laboratory, depth, found)
    return found


def _suite(laboratory: Laboratory, depth: str, *, frames: int) -> dict[str, Any]:
    model = "" if laboratory.model is None else str(Path(laboratory.model).resolve())
    return {
        "name": f"charalambos {depth}",
        "summary": "HLOD refinement by error, and by error times visibility.",
        "scene": {"name": "inspection", "options": {"depth": depth, "model": model, "detail": 6}},
        "paths": ["inspection"],
        "frames": frames,
        "width": 640,
        "height": 480,
        "pipelines": [{"name": name, "stages": text} for name, text in _PIPELINES.items()],
        "quick": {"frames": max(frames // 12, 4), "width": 320, "height": 240, "options": {"detail": 4}, "seconds": 60},
    }


def _scene(laboratory: Laboratory, depth: str, found: Replication) -> None:
    # judged by the truth in a few views; what coherence is worth is seen in all of them
    laboratory.run(depth, _suite(laboratory, depth, frames=12))
    played, whole = laboratory.play(depth, _suite(laboratory, depth, frames=500), pictures=_PICTURES, every=_EVERY)
    label = _SCENES[depth]
    nodes = {name: np.array(one.drawn_objects, float) for name, one in played.items()}
    rarn = {name: np.array(one.counted("hlod", "rarn")) for name, one in played.items()}
    rates = {name: [1e3 / ms for ms in one.frame_ms] for name, one in played.items()}
    for name, one in played.items():
        paper = _PAPER[depth].get(name, (None, None, None))
        fps = 1e3 / float(np.mean(one.frame_ms))
        measured = (fps, float(nodes[name].mean()), float(rarn[name].mean()))
        for column, theirs, ours in zip(("FPS", "DN", "RARN"), paper, measured, strict=True):
            found.cells.append(Cell("Table 1", label, name, column, "", theirs, ours))
        # what the drawn nodes were rid of is not in their number
        asked = float(np.mean([sum(s.queries for s in r.stages) for r in one.records]))
        triangles = float(np.mean([r.triangles for r in one.records]))
        found.cells.append(Cell("Table 1", label, name, "Queries", "", None, asked))
        found.cells.append(Cell("Table 1", label, name, "Triangles", "", None, triangles))
    found.cells += _ratios(depth, {n: float(v.mean()) for n, v in nodes.items()}, nodes)
    found.cells += _likeness(depth, played, whole)
    rate, drawn, picture = _FIGURES[depth]
    found.plots.append(
        Plot(f"Figure {rate}: frame rates, {label}", f"frames per second, every {_EVERY}th frame", rates)
    )
    found.plots.append(
        Plot(f"Figure {drawn}: drawn nodes, {label}", "drawn nodes", {n: v.tolist() for n, v in nodes.items()})
    )
    found.pictures.append(_picture(f"Figure {picture}: {label}", played, sorted(whole)[min(_SHOWN, len(whole) - 1)]))
    found.remarks += _remarks(label, depth, found.cells)


def _ratios(depth: str, mean: dict[str, float], nodes: dict[str, NDArray[np.float64]]) -> list[Cell]:
    label, paper = _SCENES[depth], {name: row[1] for name, row in _PAPER[depth].items()}
    cells = []
    # the last part of the path is the extreme close-up that the authors left open
    late = slice(int(0.7 * len(nodes["SW-eps_q"])), None)
    for name in ("CHLOD-eps_q", *_RANK, *_OURS):
        theirs = paper.get(name)
        saved = None if theirs is None else theirs / paper["CHLOD-eps"]
        excess = None if theirs is None else 100 * (theirs / paper["SW-eps_q"] - 1)
        cells.append(Cell("Drawn nodes", label, name, "of CHLOD-eps", "", saved, mean[name] / mean["CHLOD-eps"]))
        cells.append(
            Cell("Drawn nodes", label, name, "over SW-eps_q", "%", excess, 100 * (mean[name] / mean["SW-eps_q"] - 1))
        )
        close = 100 * (float(nodes[name][late].mean()) / float(nodes["SW-eps_q"][late].mean()) - 1)
        cells.append(Cell("Drawn nodes", label, name, "over SW-eps_q in the last close-up", "%", None, close))
    return cells


def _likeness(depth: str, played: dict[str, Any], whole: dict[int, NDArray[np.uint8]]) -> list[Cell]:
    """How like the pictures are to CHLOD-eps, and to full detail."""
    cells = []
    for name, one in played.items():
        for what, of in (("CHLOD-eps", played["CHLOD-eps"].pictures), ("full detail", whole)):
            if name == what:
                continue
            values = [likeness(one.pictures[i], of[i]) for i in sorted(whole)]
            for kind, unit in (("SNR", "dB"), ("SSIM", ""), ("FLIP", "")):
                numbers = [v[kind] for v in values if kind in v]
                if numbers:
                    worst = max(numbers) if kind == "FLIP" else min(numbers)
                    column = f"{kind} against {what}, at worst"
                    cells.append(Cell("Image", _SCENES[depth], name, column, unit, None, float(worst)))
    return cells


def _picture(title: str, played: dict[str, Any], index: int) -> Picture:
    """The paper's four images: boxes above frames, ε on the left and ε^q on the right."""
    columns = []
    for name in ("CHLOD-eps", "CHLOD-eps_q"):
        frame = played[name].drawn[index].frame
        lines = HlodBoxes().lines(frame) if name != "CHLOD-eps" else _plain(frame)
        height, width = played[name].pictures[index].shape[:2]
        with OffscreenWindow(width, height, (1.0, 1.0, 1.0)) as window:
            Gizmos(window.renderer).show(lines, [])
            window.draw(frame.view)
            columns.append(np.concatenate([window.image(), played[name].pictures[index]]))
    caption = (
        f"View {index}. Left: CHLOD-eps. Right: CHLOD-eps_q; boxes are blue where the error is taken as it is, and red "
        "where next to nothing of the box is visible."
    )
    return Picture(title, caption, np.concatenate(columns, axis=1))


def _plain(frame: Frame) -> list[Lines]:
    cut = frame.get(HlodCut)
    return [Lines(box_edges(cut.tree.boxes[:, cut.nodes]), (0.0, 0.05, 1.0), 1.5)]


def _remarks(label: str, depth: str, cells: list[Cell]) -> list[str]:
    def value(row: str, column: str) -> float:
        return next(c.measured for c in cells if (c.scene, c.row, c.column) == (label, row, column))

    paper = _PAPER[depth]
    saved, aim = value("CHLOD-eps_q", "of CHLOD-eps"), paper["CHLOD-eps_q"][1] / paper["CHLOD-eps"][1]
    excess, theirs = value("CHLOD-eps_q", "over SW-eps_q"), 100 * (paper["CHLOD-eps_q"][1] / paper["SW-eps_q"][1] - 1)
    ours = value("temporal", "over SW-eps_q")
    trimmed = value("temporal, trimmed", "over SW-eps_q")
    rarn = value("CHLOD-eps_q", "RARN"), value("CHLOD-eps_q, rank", "RARN"), value("temporal", "RARN")
    return [
        f"{label}: CHLOD-eps_q draws {saved:.2f} of CHLOD-eps's nodes (paper {aim:.2f}) and {excess:+.0f} % against "
        f"SW-eps_q (paper {theirs:+.0f} %); predicted from the last frame {ours:+.0f} %, trimmed {trimmed:+.0f} %.",
        f"{label}: RARN is {rarn[0]:.2f} (paper {paper['CHLOD-eps_q'][2]}); by the rank in the queue "
        f"{rarn[1]:.2f}, by the last frame {rarn[2]:.2f}.",
    ]
