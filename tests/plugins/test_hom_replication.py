"""The replication of Kristmann 2022, on few bunnies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import scenegraph as sg
from scenegraph.compare.replication import Laboratory, as_json
from scenegraph_hom import replication


@pytest.mark.gl
def test_every_figure_has_its_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = replication._suite

    def small(*args: Any) -> dict[str, Any]:
        suite = whole(*args)
        suite["scene"]["options"]["count"] = 150
        return suite | {"width": 320, "height": 240}

    monkeypatch.setattr(replication, "_suite", small)
    laboratory = Laboratory(sg.registry(), tmp_path, lambda *_: None, quick=True, model=None)
    found = replication.replicate(laboratory)
    by_table: dict[str, set[str]] = {}
    for cell in found.cells:
        by_table.setdefault(cell.table.partition(",")[0], set()).add(cell.row)
    assert set(by_table) == {"Figure 3.1", "Figure 4.6", "Figure 4.7", "Figure 4.9", "Figure 4.10"}
    assert {"Visible pixels", "Tessellation level", "SNR at its own level, dB"} < by_table["Figure 3.1"]
    assert {"frustum", "HOM", "HOM+LV"} <= by_table["Figure 4.6"]
    assert {"HOM as printed", "HOM+LV as printed", "whole scene"} < by_table["Figure 4.7"]
    whole_scene = {c.paper: c.measured for c in found.cells if c.row == "whole scene"}
    assert whole_scene == {294_058_800: 150 * 58_800, 588_058_800: 150 * 58_800}
    assert all(c.measured == 0 for c in found.cells if c.column == "False hides")
    level = {c.column: c.measured for c in found.cells if c.row == "Tessellation level"}
    seen = {c.column: c.measured for c in found.cells if c.row == "Visible pixels"}
    # Figure 3.1: as much to be seen, and fewer triangles behind small holes
    assert seen["many small holes"] == pytest.approx(seen["one large hole"], rel=0.1)
    assert level["many small holes"] < level["one large hole"]
    assert len(found.plots) == 4
    for plot in found.plots:
        assert all(len(values) == len(plot.paths) for values in plot.series.values())
    assert set(as_json(found)) == {"paper", "cells", "added", "plots", "remarks", "runs"}
