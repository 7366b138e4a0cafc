"""The pictures of occlusion maps in the docs: map and pyramid, a block and its coefficients, levels of visibility.

Run it from the root of the project: ``python docs/images/hom_pictures.py docs/images``; with a model file as second
argument the bunnies are made of it. The plots along the paths are made from a finished replication:
``python docs/images/hom_pictures.py docs/images MODEL results/kristmann2022/replication.json``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from scenegraph import LevelOfVisibility, Pipeline, View, registry
from scenegraph.kernels.pyramids import map_cell_texels
from scenegraph.viewer.window import ViewerWindow
from scenegraph_hom import OcclusionMap, plot_block

HOM = "frustum | hom(width=1024, height=512, active=1200, triangles=400000)"
SIZE = (960, 640)


def map_and_pyramid(folder: Path) -> None:
    """The map of a street, its depths, and three levels of its pyramid."""
    scene = registry().scenes["city"].build()
    with Pipeline.parse("frustum | hom").open(scene.snapshot()) as pipeline:
        occlusion = pipeline.run(scene.paths["street"][20]).get(OcclusionMap)
    figure = Figure(figsize=(10, 4.1), layout="constrained")
    axes = figure.subplots(2, 3)
    depth = np.where(np.isfinite(occlusion.depth()), occlusion.depth(), np.nan)
    axes[0, 0].imshow(occlusion.picture(), cmap="gray", vmin=0, vmax=255)
    axes[0, 0].set_title("map of 512 × 256 texels: closed ones white", fontsize=9)
    shown = axes[0, 1].imshow(np.log10(depth[::-1]), cmap="viridis_r")
    bar = figure.colorbar(shown, ax=axes[0, 1], shrink=0.7, ticks=[1, 2, 3])
    bar.ax.set_yticklabels(["10 m", "100 m", "1 km"])
    axes[0, 1].set_title("depth bound: what is farther is hidden", fontsize=9)
    for at, level in zip((axes[0, 2], *axes[1]), (2, 4, 5, 6), strict=True):
        image = occlusion.counts[level] / map_cell_texels(occlusion.size, level)
        at.imshow(image[::-1], cmap="gray", vmin=0, vmax=1)
        at.set_title(f"pyramid level {level}: {image.shape[1]} × {image.shape[0]} cells", fontsize=9)
    for at in axes.flat:
        at.set(xticks=[], yticks=[])
    save(figure, folder / "hom-map.png")


def blocks(folder: Path, model: str) -> None:
    """Figure 3.4 for both objects of the foliage."""
    scene = registry().scenes["foliage"].build(model=model)
    snapshot = scene.snapshot()
    with Pipeline.parse("hom(least=1, width=1024, height=768)").open(snapshot) as pipeline:
        for name, view in scene.views.items():
            frame = pipeline.run(view.resized(1024, 768))
            row = next(r for r, g in enumerate(snapshot.geodes) if g.name == f"object behind the {name}")
            save(plot_block(frame.get(OcclusionMap), snapshot.boxes[:, row]), folder / f"hom-block-{name}.png")


def visibility(folder: Path, model: str) -> None:
    """Figures 4.3 and 4.4: the dense bunnies from the front, and the same frame from behind."""
    known = registry()
    scene = known.scenes["bunnies-5001"].build(model=model)
    front = scene.paths["enter"][14].resized(*SIZE)
    viewer = ViewerWindow(scene.snapshot(), [Pipeline.parse(HOM, known)], known, size=SIZE, off_screen=True)
    session = viewer.session
    viewer.plotter.show(auto_close=False)
    session.coloring = next(o for o in session.overlays if o.name == "level of visibility")
    inset = next(o for o in session.overlays if o.name == "occlusion map")
    session.gizmos = [inset]
    session.view = front
    viewer.render()
    frame = session.driver.frame
    assert frame is not None
    occlusion, value = frame.get(OcclusionMap), frame.get(LevelOfVisibility).values
    partly = frame.visible & (value > 0.3) & (value < 0.7)
    partly[occlusion.rows] = False
    # the largest of what is half covered
    size = np.where(partly, frame.view.box_pixels(frame.snapshot.boxes), 0.0)
    session.picked = int(frame.snapshot.keys[int(np.argmax(size))])
    write(viewer, folder / "hom-visibility.png")
    session.gizmos = []
    session.toggle_freeze()
    behind = View(-np.array(front.eye) * 1.45, (0, 0, 0), scene.up, fov=front.fov, near=0.1, far=500.0)
    session.view = behind.resized(*SIZE)
    write(viewer, folder / "hom-visibility-behind.png")
    viewer.close()


def along_paths(folder: Path, replication: Path) -> None:
    """The figures of the thesis with the numbers of a replication."""
    found = json.loads(replication.read_text(encoding="utf-8"))
    figure = Figure(figsize=(10, 6.4), layout="constrained")
    colors = ("#555555", "#2c6fbb", "#c0392b", "#8fb8de", "#e39b92")
    for axes, plot in zip(figure.subplots(2, 2).flat, found["plots"], strict=True):
        for (name, values), color in zip(plot["series"].items(), colors, strict=False):
            style = "--" if "printed" in name else "-"
            axes.plot(values, label=name, color=color, linestyle=style, linewidth=1.4)
        change = next((i for i, p in enumerate(plot["paths"]) if p != plot["paths"][0]), 0)
        axes.axvline(change - 0.5, color="0.8", linewidth=0.8)
        axes.set_title(plot["title"], fontsize=9)
        axes.set_ylim(bottom=0)
        axes.set_xlabel(f"view; {plot['paths'][0]}, then {plot['paths'][-1]}", fontsize=8)
        axes.set_ylabel(plot["unit"], fontsize=8)
        axes.tick_params(labelsize=8)
        axes.legend(fontsize=7, frameon=False)
    save(figure, folder / "kristmann2022.png")


def save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=110, facecolor="white")
    Image.open(path).convert("RGB").quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)
    sys.stdout.write(f"wrote {path}, {path.stat().st_size / 1000:.0f} kB\n")


def write(viewer: ViewerWindow, path: Path) -> None:
    Image.fromarray(viewer.image()).quantize(160, dither=Image.Dither.NONE).save(path, optimize=True)
    sys.stdout.write(f"wrote {path}, {path.stat().st_size / 1000:.0f} kB\n")


if __name__ == "__main__":
    given = sys.argv[1:]
    where, model_file = Path(given[0] if given else "."), given[1] if len(given) > 1 else ""
    if len(given) > 2:
        along_paths(where, Path(given[2]))
    else:
        map_and_pyramid(where)
        blocks(where, model_file)
        visibility(where, model_file)
