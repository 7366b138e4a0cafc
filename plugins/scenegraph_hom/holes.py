"""Figure 3.1 of Kristmann 2022 as numbers: as much to be seen through one large hole and through many small ones.

Both objects are drawn in full, at the level that their level of visibility asks for, and at the level of the one behind
the small holes: the last two say what a coarser level costs where, the same level what it costs here and there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, LevelOfVisibility, Lod, Snapshot, View
from scenegraph.compare.metrics import snr_db, ssim, wrong_pixels
from scenegraph.compare.replication import Cell, Laboratory

TABLE, SCENE = "Figure 3.1", "foliage"
STAGES = "hom(least=1, width=1024, height=768) | lod_visibility"
ROWS = {"wall": "one large hole", "tree": "many small holes"}


def holes_cells(laboratory: Laboratory, model: str) -> tuple[list[Cell], list[str]]:
    """Measure both objects; cells, and what to say about them."""
    from scenegraph.render.item_buffer import ItemBuffer

    views: list[Frame] = []
    suite = {
        "name": "kristmann2022 foliage",
        "scene": {"name": SCENE, "options": {"model": model}},
        "paths": list(ROWS),
        "frames": 24,
        "width": 1024,
        "height": 768,
        "pipelines": [{"name": "HOM+LV", "stages": STAGES}],
        "warmup": 0,
    }

    counted = laboratory.count(SCENE, suite, look=lambda _name, _index, frame: views.append(frame))
    # the last view of each path is the nearest
    frames = dict(zip(counted.paths, views, strict=True))
    snapshot = frames["wall"].snapshot
    objects = {
        name: next(r for r, g in enumerate(snapshot.geodes) if isinstance(g, Lod) and g.name.endswith(f"the {name}"))
        for name in ROWS
    }
    buffer = ItemBuffer(snapshot)
    seen: dict[str, tuple[int, int]] = {}
    for name, row in objects.items():
        view = frames[name].view
        with_all = int(buffer.render(view).pixels[row])
        seen[name] = with_all, _alone(snapshot, row, view)
    buffer.close()
    cells: list[Cell] = []
    level = {name: int(frames[name].level[row]) for name, row in objects.items()}
    finest = int(snapshot.level_count[objects["wall"]])
    for name, row in objects.items():
        view, label = frames[name].view, ROWS[name]
        values: dict[tuple[str, str], float] = {
            ("Visible pixels", ""): seen[name][0],
            ("Of all its pixels", "%"): 100 * seen[name][0] / max(seen[name][1], 1),
            ("Level of visibility", ""): _visibility(frames[name], row),
            ("Tessellation level", ""): finest - level[name],
            ("Triangles", ""): int(snapshot.triangles[level[name], row]),
        }
        values |= _errors(snapshot, view, row, level[name], "its own level")
        values |= _errors(snapshot, view, row, level["tree"], "the tree's level")
        # a line for each quantity: eleven columns fit on no screen
        cells += [
            Cell(TABLE, SCENE, f"{what}, {unit}" if unit else what, label, "", None, value)
            for (what, unit), value in values.items()
        ]
    more = seen["tree"][0] / max(seen["wall"][0], 1)
    remark = (
        f"Figure 3.1: behind small holes {more:.2f} × as many pixels can be seen as through the large one, and the "
        f"tessellation level is {finest - level['tree']} instead of {finest - level['wall']} of {finest}."
    )
    return cells, [remark]


def _visibility(frame: Frame, row: int) -> float:
    return float(frame.get(LevelOfVisibility).values[row])


def _alone(snapshot: Snapshot, row: int, view: View) -> int:
    """Pixels of a row with nothing else in the picture."""
    picture = _drawn(snapshot, view, np.arange(snapshot.n) == row, 0, row)
    empty = _drawn(snapshot, view, np.zeros(snapshot.n, bool), 0, row)
    return int((picture != empty).any(axis=2).sum())


def _errors(snapshot: Snapshot, view: View, row: int, level: int, where: str) -> dict[tuple[str, str], float]:
    everything = np.ones(snapshot.n, bool)
    reference, picture = (_drawn(snapshot, view, everything, k, row) for k in (0, level))
    return {
        (f"Wrong pixels at {where}", ""): wrong_pixels(picture, reference),
        (f"SNR at {where}", "dB"): snr_db(picture, reference),
        (f"SSIM at {where}", ""): ssim(picture, reference),
    }


def _drawn(snapshot: Snapshot, view: View, visible: NDArray[np.bool_], level: int, row: int) -> Any:
    """The picture of some rows, one of them at a level of its own."""
    from scenegraph.render.drawing import Drawing
    from scenegraph.render.window import OffscreenWindow

    levels = np.zeros(snapshot.n, np.uint8)
    levels[row] = level
    with OffscreenWindow(view.width, view.height, snapshot.scene.background) as window:
        drawing = Drawing(snapshot, window.renderer)
        drawing.show(visible, levels)
        window.draw(view)
        picture = window.image()
        drawing.remove()
    return picture
