"""Tables 1 and 2 and Figures 5 and 6 of Papaioannou et al. 2006, measured here.

The paper's scenes are lost. `olympia` and `city` have its numbers of triangles (≈ 250 k and ≈ 500 k), one solid and
several planar occluders a building, and paths with the close-ups A, B and C. "No occlusion culling" is view-frustum
culling in the paper too. What can be compared is how much planar and solid occluders take away; the milliseconds are
those of another machine in another century, and stand there for their ratios.
"""

from __future__ import annotations

from typing import Any

from scenegraph.compare.replication import Cell, Laboratory, Replication

#: Paper's numbers: average primitives a frame, draw ms, overhead ms.
_PAPER = {
    "olympia": (
        "Table 1",
        {"none": (73096.9, 100.57, None), "planar": (57150.1, 89.71, 0.99), "solid": (52882.0, 85.14, 1.89)},
    ),
    "city": (
        "Table 2",
        {"none": (145488.8, 136.80, None), "planar": (100038.2, 92.60, 1.19), "solid": (81064.2, 78.26, 2.63)},
    ),
}
_COLUMNS = (("Average primitives/frame", ""), ("Average draw time", "ms"), ("Average overhead", "ms"))
_ACTIVE = 15
_PIPELINES = {
    "none": "frustum",
    "planar": f"frustum | shadow(occluders='planar', active={_ACTIVE})",
    "solid": f"frustum | shadow(occluders='solid', active={_ACTIVE})",
    "both": f"frustum | shadow(occluders='both', active={_ACTIVE})",
    "solid, ranking as printed": f"frustum | shadow(occluders='solid', active={_ACTIVE}, ranking='printed')",
    "solid, ranked by solid angle": f"frustum | shadow(occluders='solid', active={_ACTIVE}, ranking='solid_angle')",
    "solid, marginal ranking": f"frustum | shadow(occluders='solid', active={_ACTIVE}, ranking='marginal')",
    "both, marginal ranking": f"frustum | shadow(occluders='both', active={_ACTIVE}, ranking='marginal')",
}


def replicate(laboratory: Laboratory) -> Replication:
    """Run both scenes and lay the numbers beside the paper's."""
    found = Replication(
        "papaioannou2006", "Efficient Occlusion Culling using Solid Occluders (Papaioannou et al. 2006)"
    )
    for scene, (table, paper) in _PAPER.items():
        summary = laboratory.run(scene, _suite(scene))
        found.cells += _cells(table, scene, paper, summary["pipelines"])
        found.remarks += _remarks(scene, paper, summary["pipelines"])
        fitted = laboratory.run(f"{scene}, fitted occluders", _suite(scene, fitted=True))
        found.cells += _cells(table, f"{scene}, fitted occluders", {}, fitted["pipelines"])
    return found


def _suite(scene: str, *, fitted: bool = False) -> dict[str, Any]:
    names = ("none", "planar", "solid", "both") if fitted else tuple(_PIPELINES)
    return {
        "name": f"papaioannou2006 {scene}{', fitted' if fitted else ''}",
        "summary": "Shadow frusta of planar and of convex solid occluders.",
        "scene": {"name": scene, "occluders": "fitted" if fitted else "declared"},
        "paths": ["walk" if scene == "olympia" else "street"],
        "frames": 64,
        "width": 1024,
        "height": 768,
        "pipelines": [{"name": name, "stages": _PIPELINES[name]} for name in names],
        "quick": {"frames": 12, "seconds": 60},
    }


def _cells(table: str, scene: str, paper: dict[str, Any], pipelines: dict[str, Any]) -> list[Cell]:
    cells = []
    for row, result in pipelines.items():
        overhead = sum(s["ms"] for s in result["stages"] if s["name"] == "shadow") if row != "none" else None
        measured = (result["drawn_triangles"], result["draw_ms"], overhead)
        for (column, unit), theirs, ours in zip(_COLUMNS, paper.get(row, (None, None, None)), measured, strict=True):
            if ours is not None:
                cells.append(Cell(table, scene, row, column, unit, theirs, ours))
        base, ours = pipelines["none"]["drawn_triangles"], result["drawn_triangles"]
        known = paper[row][0] / paper["none"][0] - 1 if row in paper else None
        if row != "none":
            percent = None if known is None else 100 * known
            cells.append(Cell(table, scene, row, "Change in primitives", "%", percent, 100 * (ours / base - 1)))
            cells.append(Cell(table, scene, row, "False hides", "", None, result["false_hides_total"]))
    return cells


def _remarks(scene: str, paper: dict[str, Any], pipelines: dict[str, Any]) -> list[str]:
    remarks = []
    for row in ("planar", "solid"):
        aim = 1 - paper[row][0] / paper["none"][0]
        here = 1 - pipelines[row]["drawn_triangles"] / pipelines["none"]["drawn_triangles"]
        verdict = "at least the paper's" if here >= aim else "less than the paper's"
        remarks.append(f"{scene}: {row} occluders take away {here:.1%} of the primitives, {verdict} {aim:.1%}.")
    worst = max(sum(s["ms"] for s in p["stages"] if s["name"] == "shadow") for n, p in pipelines.items() if n in paper)
    share = worst / pipelines["none"]["draw_ms"]
    remarks.append(f"{scene}: the overhead is at most {share:.2%} of the draw time without occlusion culling.")
    return remarks
