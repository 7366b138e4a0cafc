"""The pictures of the LOD stages in the docs: levels of a mesh, a field drawn by them, and two curves.

Run it from the root of the project: ``python docs/images/lod_pictures.py docs/images``.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pyvista as pv
import trimesh
from matplotlib.figure import Figure
from PIL import Image

from scenegraph import Frame, Group, Lod, Mesh, Pipeline, Scene, Snapshot, Transform, View
from scenegraph.meshes import level_chain
from scenegraph.viewer.colorings import level_colors

INK, RED, BLUE = "0.35", "#c0392b", "#2c6fbb"
#: Bytes of a picture in the docs.
LARGEST = 250_000


def bumpy_ball() -> Mesh:
    """A ball of 20 480 triangles with bumps of a tenth of its radius."""
    ball = trimesh.creation.icosphere(subdivisions=5)
    x, y, z = ball.vertices.T
    radius = 1 + 0.1 * np.sin(9 * x) * np.sin(7 * y + 1) * np.sin(8 * z + 2)
    return Mesh(ball.vertices * radius[:, None], ball.faces)


def field(chain: list[tuple[Mesh, float]], count: int) -> Snapshot:
    """Balls of different sizes on a plain."""
    rng = np.random.default_rng(4)
    places = np.column_stack([rng.uniform(-60, 60, (count, 2)), np.zeros(count)])
    levels, errors = [m for m, _ in chain], [e for _, e in chain]
    nodes = (
        Transform(Lod(*levels, errors=errors), translation=p, scale=s)
        for p, s in zip(places, rng.uniform(0.7, 2.5, count), strict=True)
    )
    return Scene(Group(*nodes)).snapshot()


def one_frame(snapshot: Snapshot, view: View, text: str) -> Frame:
    """A frame of a pipeline."""
    with Pipeline.parse(text).open(snapshot) as pipeline:
        return pipeline.run(view)


def draw_levels(chain: list[tuple[Mesh, float]], size: tuple[int, int]) -> np.ndarray:
    """The levels side by side, with their triangles and errors."""
    plotter = pv.Plotter(off_screen=True, window_size=size)
    extent = float(np.ptp(chain[0][0].bounds, axis=0).max())
    for i, (mesh, error) in enumerate(chain):
        surface = pv.PolyData.from_regular_faces(mesh.vertices + (2.5 * i, 0, 0), mesh.faces)
        plotter.add_mesh(surface, color=level_colors(len(chain))[i], show_edges=i > 3, edge_color="gray")
        words = f"{mesh.triangles}" + (f"\n{error / extent:.2%}" if i else "\ntriangles")
        where = (int(size[0] * (2.5 * i + 1.25) / (2.5 * len(chain))) - 35, 4)
        plotter.add_text(words, position=where, font_size=8, color="black")
    plotter.enable_parallel_projection()
    middle = 1.25 * (len(chain) - 1)
    plotter.camera_position = [(middle, -10, -0.45), (middle, 0, -0.45), (0, 0, 1)]
    plotter.camera.parallel_scale = 1.27 * len(chain) * size[1] / size[0]
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(image)


def draw_frame(frame: Frame, words: str, size: tuple[int, int]) -> np.ndarray:
    """What a frame leaves, in the colors of the levels."""
    plotter = pv.Plotter(off_screen=True, window_size=size)
    snapshot = frame.snapshot
    colors = level_colors(len(snapshot.triangles))
    for row in np.flatnonzero(frame.visible):
        mesh = snapshot.meshes[frame.mesh_index()[row]]
        surface = pv.PolyData.from_regular_faces(mesh.vertices, mesh.faces)
        surface = surface.transform(snapshot.transforms[snapshot.transform_index[row]], inplace=False)
        plotter.add_mesh(surface, color=colors[frame.level[row]])
    frame.view.to_vtk(plotter.camera)
    plotter.add_text(words, position=(6, size[1] - 24), font_size=9, color="black")
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(image)


def levels_picture(chain: list[tuple[Mesh, float]], snapshot: Snapshot) -> Image.Image:
    """Levels above, a field at two limits below."""
    size = (424, 260)
    view = View((0, -75, 24), (0, -8, 0), fov=40, width=1280, height=785)
    rows = [draw_levels(chain, (3 * size[0], 230))]
    below = []
    for text, name in (("none", "finest"), ("lod_error(pixels=1)", "pixels=1"), ("lod_error(pixels=4)", "pixels=4")):
        frame = one_frame(snapshot, view, text)
        below.append(draw_frame(frame, f"{name}: {frame.drawn_triangles():,} triangles", size))
    rows.append(np.concatenate(below, axis=1))
    return Image.fromarray(np.concatenate(rows))


def budget_curve(snapshot: Snapshot) -> Figure:
    """Triangles and largest error over the budget."""
    view = View((0, -70, 9), (0, 0, 0), fov=40)
    full, coarsest = (int(snapshot.triangles[i].sum()) for i in (0, -1))
    budgets = np.geomspace(0.5 * coarsest, 1.3 * full, 60).astype(int)
    used, worst = [], []
    for budget in budgets.tolist():
        frame = one_frame(snapshot, view, f"lod_budget(triangles={budget})")
        used.append(frame.drawn_triangles())
        errors = view.error_pixels(snapshot.errors[frame.level, np.arange(snapshot.n)], snapshot.boxes)
        worst.append(float(errors.max()))
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.loglog(budgets, used, color=BLUE)
    left.loglog(budgets, budgets, color=INK, linestyle=":")
    left.set(xlabel="budget", ylabel="triangles drawn")
    right.loglog(budgets, np.maximum(worst, 1e-2), color=RED)
    right.set(xlabel="budget", ylabel="largest error, pixels")
    for axes in (left, right):
        axes.axvspan(budgets[0], coarsest, color="0.92")
        axes.spines[["top", "right"]].set_visible(False)
    right.text(budgets[0] * 1.1, 0.02, "the coarsest levels\ndo not fit", fontsize=8, color=INK)
    return figure


def stress_curve(snapshot: Snapshot) -> Figure:
    """Time of a frame and stress over a flight that goes down into the field and up again."""
    steps = np.linspace(0, 1, 150)
    eyes = np.column_stack([0 * steps, -110 + 110 * steps, 4 + 30 * np.abs(2 * steps - 1) ** 2])
    views = [View(e, e + (0, 40, -6), fov=50) for e in eyes]
    allowed = 2.0
    texts = {
        "lod_error": "frustum | lod_stress(milliseconds=1000, clock=triangles)",
        "lod_stress": f"frustum | lod_stress(milliseconds={allowed}, clock=triangles, gain=0.15, protect=300)",
    }
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (name, text), color in zip(texts.items(), (INK, RED), strict=True):
        with Pipeline.parse(text).open(snapshot) as pipeline:
            frames = [pipeline.run(v) for v in views]
        left.plot([f.record.triangles * 1e-5 for f in frames], color=color, label=name)
        right.plot([f.record.stages[1].counts["stress"] for f in frames], color=color)
    left.axhspan(0.8 * allowed, allowed, color=BLUE, alpha=0.25, linewidth=0)
    left.set(xlabel="frame", ylabel="time of the frame, ms", ylim=(0, None))
    left.legend(frameon=False)
    right.set(xlabel="frame", ylabel="stress")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def main(folder: Path) -> None:
    """Write them into a folder."""
    mpl.rcParams["svg.hashsalt"] = "scenegraph"
    chain = level_chain(bumpy_ball(), cache=None)
    for (coarse, error), (fine, _) in zip(chain[1:], itertools.chain(chain), strict=False):
        sys.stdout.write(f"{coarse.triangles} of {fine.triangles} triangles, error {error:.4f}\n")
    picture = levels_picture(chain, field(chain, 120))
    path = folder / "lod-levels.png"
    picture.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
    assert path.stat().st_size < LARGEST, path.stat().st_size
    snapshot = field(chain, 400)
    for name, figure in (("lod-budget", budget_curve(snapshot)), ("lod-stress", stress_curve(snapshot))):
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
