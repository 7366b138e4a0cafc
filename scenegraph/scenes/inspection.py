"""Scanned models to be inspected, with little, middling or much of them behind others.

Charalambos' three test scenes are Stanford models "with low, middle and high depth complexities", each looked at in a
session of "rotations and changes from overall views to extreme close-ups". Which models, how many and where they stand
the paper does not say. Give `model` a file, or a folder of files; without, bumpy figures stand in for scans.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..nodes import Geode, Transform
from ..scene import Scene
from ..view import View
from .scatter import one_mesh
from .shapes import Floats, bumps, icosphere, vertex_normals

#: How many models stand where: rows, columns, and the distance of neighbors in model heights.
LAYOUTS = {"low": (1, 2, 1.5), "middle": (3, 3, 1.15), "high": (4, 4, 0.8)}
#: Models with more triangles than this stand alone, not in a crowd.
CROWD_TRIANGLES = 100_000
SUFFIXES = (".ply", ".obj", ".glb", ".gltf", ".stl", ".off")
PALETTE = ((0.82, 0.78, 0.70), (0.66, 0.72, 0.78), (0.80, 0.66, 0.58), (0.68, 0.76, 0.64), (0.78, 0.72, 0.80))


def build(*, depth: str = "middle", model: str = "", detail: int = 5, views: int = 500, seed: int = 1) -> Scene:
    """Scanned models, or figures in their place, in a row or a crowd.

    Parameters
    ----------
    depth : {"low", "middle", "high"}
        Two models side by side, nine, or sixteen close behind one another.
    model : str
        A model file, or a folder of them; figures without.
    detail : int
        Of the figures: they have 20 · 4^detail triangles each.
    views : int
        Length of the path.
    seed : int
        Of the figures, and of how models are turned.

    Returns
    -------
    Scene
        With the path "inspection": once around, three close-ups with overviews between them, the last one extreme.

    Raises
    ------
    SceneError
        An option out of range, or a model that cannot be read.
    """
    if depth not in LAYOUTS:
        raise SceneError(f"inspection: depth={depth!r}; choose low, middle or high")
    if not 0 <= detail <= 8:
        raise SceneError(f"inspection: detail={detail}; choose 0 to 8")
    if views < 2:
        raise SceneError(f"inspection: views={views}; a path needs at least 2")
    rng = np.random.default_rng(seed)
    meshes = _scans(Path(model), crowd=depth != "low") if model else [figure(rng, detail) for _ in range(3)]
    rows, columns, gap = LAYOUTS[depth]
    scene = Scene(name=f"inspection, {depth}", background=(0.93, 0.94, 0.96))
    points = []
    for number, (i, j) in enumerate(np.ndindex(rows, columns)):
        mesh = meshes[number % len(meshes)]
        # a model is two units tall; every second row stands in the gaps of the one before
        x = 2 * gap * (j - (columns - 1) / 2 + 0.25 * (-1) ** i * (rows > 1))
        y = 2 * gap * (i - (rows - 1) / 2)
        turn = np.radians(rng.uniform(-40, 40) if depth != "low" else 20 * (-1) ** j)
        c, s = np.cos(turn), np.sin(turn)
        matrix = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])
        color = None if mesh.vertex_colors is not None else PALETTE[number % len(PALETTE)]
        scene.add(Transform(Geode(mesh, color=color, name=f"{mesh.name} {number + 1}"), matrix=matrix))
        points.append(mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])
    scene.paths = {"inspection": session(points, count=views)}
    return scene


def figure(rng: np.random.Generator, detail: int = 5) -> Mesh:
    """A bumpy body about two units tall of 20·4^detail triangles: coarse limbs, folds on them, and grain."""
    directions, faces = icosphere(detail)
    radius = 0.62 + 0.22 * bumps(directions, rng, waves=8, roughness=1.8)
    radius += 0.05 * bumps(directions, rng, waves=24, roughness=6.0)
    radius += 0.008 * bumps(directions, rng, waves=48, roughness=25.0)
    points = directions * radius[:, None] * (1.0, 0.9, 1.3)
    points = _fitted(points)
    return Mesh(points, faces, name="figure", normals=vertex_normals(points, faces))


def _fitted(points: Floats) -> Floats:
    """Two units tall, standing on z = 0 in the middle of x and y."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    middle[2] = low[2]
    # a flat model is as wide as others are tall
    size = float(high[2] - low[2]) or float((high - low).max()) or 1.0
    scale = 2.0 / max(size, 0.6 * float((high - low).max()))
    return np.asarray((points - middle) * scale)


def _scans(path: Path, *, crowd: bool) -> list[Mesh]:
    """The models of a file or folder; of several resolutions of a model (name_resolution) the finest that is wanted."""
    if path.is_dir():
        files = sorted(f for f in path.iterdir() if f.suffix.lower() in SUFFIXES)
        if not files:
            raise SceneError(f"inspection: there is no model in the folder {str(path)!r}")
    else:
        files = [path]
    best: dict[str, Mesh] = {}
    for file in files:
        mesh = _upright(file)
        name = file.stem.partition("_")[0]
        is_wanted = not crowd or mesh.triangles <= CROWD_TRIANGLES or len(files) == 1
        if is_wanted and mesh.triangles > (best[name].triangles if name in best else 0):
            best[name] = mesh
    if not best:
        raise SceneError(f"inspection: every model in {str(path)!r} has more than {CROWD_TRIANGLES} triangles")
    return sorted(best.values(), key=lambda m: -m.triangles)


def _upright(file: Path) -> Mesh:
    """A model, smooth, with the y axis of scans turned up unless the file has another idea of what is up."""
    loaded = Scene.load(file)
    mesh = one_mesh(loaded)
    points = mesh.vertices
    # scans are made with y up and say nothing of it
    if loaded.up == (0.0, 1.0, 0.0) or file.suffix.lower() in (".ply", ".stl", ".off"):
        points = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    points = _fitted(points)
    faces = mesh.faces.astype(np.int64)
    return Mesh(points, faces, name=file.stem, normals=vertex_normals(points, faces), vertex_colors=mesh.vertex_colors)


def session(points: list[Floats], *, count: int = 500, fov: float = 45.0) -> list[View]:
    """An inspection: once around everything, close-ups of three models, and back to an overview between them.

    Parameters
    ----------
    points : list of (k, 3) float
        Vertices of each model.
    count : int

    Notes
    -----
    A close-up looks at the point of a model that is farthest out in the direction of the eye, and turns by up to 35°
    around it: the eye then stays outside the model, however near it is.
    """
    everything = np.concatenate([np.stack([p.min(axis=0), p.max(axis=0)]) for p in points])
    low, high = everything.min(axis=0), everything.max(axis=0)
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    # distance at which a sphere around everything just fits
    whole = radius / np.sin(np.radians(fov / 2))
    near_half = 1.0 / np.sin(np.radians(fov / 2))
    # share of the path, close-up (0, 1, 2) or overview, distance, azimuth, elevation in degrees
    keys: list[tuple[float, int | None, float, float, float]] = [
        (0.00, None, 0.75 * whole, -90, 18),
        (0.22, None, 0.75 * whole, 270, 18),
        (0.30, 0, 0.55 * near_half, 285, 12),
        (0.36, 0, 0.12 * near_half, 250, 10),
        (0.42, 0, 0.10 * near_half, 305, 16),
        (0.50, None, 0.60 * whole, 400, 35),
        (0.60, None, 0.60 * whole, 560, 30),
        (0.68, 1, 0.40 * near_half, 610, 24),
        (0.74, 1, 0.10 * near_half, 640, 24),
        (0.80, None, 0.50 * whole, 720, 22),
        (0.88, 2, 0.30 * near_half, 790, 14),
        (0.93, 2, 0.06 * near_half, 815, 10),
        (1.00, 2, 0.04 * near_half, 770, 8),
    ]
    model_of = (0, len(points) // 2, len(points) - 1)
    times = np.array([k[0] for k in keys])
    values = np.empty((len(keys), 6))
    for index, (_, closeup, distance, azimuth, elevation) in enumerate(keys):
        at = center
        if closeup is not None:
            mine, model = [k for k in keys if k[1] == closeup], points[model_of[closeup]]
            direction = _direction(float(np.mean([k[3] for k in mine])), float(np.mean([k[4] for k in mine])))
            at = model[int(np.argmax(model @ direction))]
        values[index] = (*at, np.log(distance), azimuth, elevation)
    # imported here: a quarter of a second that listing the scenes does not need
    from scipy.interpolate import PchipInterpolator

    # never overshoots: a close-up comes no closer than its key says
    curve = PchipInterpolator(times, values)
    views = []
    for row in curve(np.linspace(0.0, 1.0, count)):
        distance = float(np.exp(row[3]))
        eye = row[:3] + distance * _direction(float(row[4]), float(row[5]))
        views.append(View(eye, row[:3], fov=fov, near=0.01 * distance, far=distance + 3 * radius))
    return views


def _direction(azimuth: float, elevation: float) -> Floats:
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
