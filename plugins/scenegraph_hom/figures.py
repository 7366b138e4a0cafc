"""Figure 3.4 of the thesis for any drawable: the map, the block below the rectangle, and its coefficients."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .products import OcclusionMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Kristmann's colors for occluders and occludees, dark enough for either background.
RED, BLUE = "#c0392b", "#2c6fbb"


def plot_block(occlusion: OcclusionMap, box: NDArray[np.float64]) -> Figure:
    """How the level of visibility of a world box comes about.

    Parameters
    ----------
    occlusion : OcclusionMap
        From a frame: ``frame.get(OcclusionMap)``.
    box : (6,) float
        Center and half extent, such as ``frame.snapshot.boxes[:, row]``.

    Returns
    -------
    matplotlib.figure.Figure
        Left the map with the rectangle and the cells of its block, in the middle the block's opacities, right the four
        coefficients. Save it with ``figure.savefig``.

    Raises
    ------
    ValueError
        The box reaches the near plane, or lies outside the view.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    occlusion = occlusion.by_centers
    block = occlusion.block(box)
    if block is None:
        raise ValueError("the box reaches the near plane or lies outside the view: it has no block")
    x0, y0, x1, y1 = (c << block.level for c in block.cells)
    left, low, right, high = occlusion.footprint(np.asarray(box, float).reshape(6, 1)).texels[:, 0].tolist()
    figure = Figure(figsize=(12, 3.6), layout="constrained")
    whole, cells, bars = figure.subplots(1, 3, width_ratios=(2.2, 1.2, 1))
    width, height = occlusion.size
    whole.imshow(occlusion.picture(), cmap="gray", vmin=0, vmax=255, extent=(0, width, 0, height))
    whole.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, edgecolor=BLUE, linestyle=":"))
    whole.add_patch(Rectangle((left, low), right - left, high - low, fill=False, edgecolor=RED))
    whole.set(title=f"occlusion map, {width} × {height} texels", xlabel="x", ylabel="y")
    cells.imshow(block.opacity, cmap="gray", vmin=0, vmax=1, origin="lower")
    rows, columns = block.opacity.shape
    cells.set(title=f"block of {columns} × {rows} cells, pyramid level {block.level}", xticks=[], yticks=[])
    names = ("F(0,0)", "F(1,0)", "F(0,1)", "F(1,1)")
    bars.bar(names, block.coefficients, color=[RED, BLUE, BLUE, BLUE])
    bars.axhline(0, color="0.5", linewidth=0.8)
    bars.set(title=f"level of visibility {block.visibility:+.2f}", ylabel="coefficient")
    return figure
