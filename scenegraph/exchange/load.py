"""Read a model file into a scene."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.load import compressed_loaders, mesh_formats

from ..errors import SceneError
from ..nodes import Group
from ..scene import Scene
from .build import FLAT_FAR, Builder, far_offset, world_bounds
from .cameras import FileCamera, as_views
from .gltf import load_gltf
from .obj import load_obj
from .problems import Problems, quiet_trimesh
from .short_text import refuse_short_text
from .trimesh_scene import graph_of

#: Formats of trimesh that hold no triangles (points, drawings), or are no suffix.
_NOT_MODELS = {"xyz", "stl_ascii"}
_Y_UP, _Z_UP = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_EXPORT = "open it in the program that wrote it and export it again"
_NEEDS_MESH = "export it again with at least one mesh of triangles"


def readable_suffixes() -> list[str]:
    """File name endings that `load` reads, without the dot."""
    return sorted((mesh_formats() | set(compressed_loaders)) - _NOT_MODELS)


def load(path: str | Path) -> Scene:
    """Read a model file: everything trimesh reads, with its node hierarchy, colors, textures and cameras.

    Coordinates stay in float64 and are never rotated; what lies far from its origin is moved there below a `Transform`
    (see `scenegraph.exchange.build`). `Scene.up` is (0, 1, 0) for glTF, what the file says for COLLADA, z for 3MF and
    for georeferenced files; other formats do not say, and it is guessed (see `guess_up`). What was odd but did not stop
    the import is in `Scene.problems`.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Scene
        Named after the file. Cameras of the file are its views.

    Raises
    ------
    SceneError
        The file is missing, unreadable, of an unknown kind, or has no triangles; the sentence says what to do.
    """
    path = Path(path).expanduser()
    suffix = _checked_suffix(path)
    problems = Problems()
    cameras: list[FileCamera] = []
    declared: tuple[float, float, float] | None = None
    try:
        with quiet_trimesh(problems):
            if suffix in ("glb", "gltf"):
                root, cameras, y_up = load_gltf(path, problems)
                declared = _Y_UP if y_up else None
            elif suffix == "obj":
                root = load_obj(path, problems)
            else:
                root = graph_of(_read(path, suffix), problems, path.stem)[0]
                declared = _declared_up(path, suffix)
    except SceneError:
        raise
    except ImportError as error:
        package = {"collada": "pycollada", "yaml": "pyyaml"}.get(error.name or "", error.name)
        raise SceneError(
            f"{path}: .{suffix} files need the Python package {package!r}; pip install {package}"
        ) from error
    except MemoryError as error:
        raise SceneError(f"{path} does not fit into memory; split it or simplify it first") from error
    except Exception as error:  # readers raise whatever broken bytes lead them to
        reason = str(error).split("\n", 1)[0][:120] or type(error).__name__
        raise SceneError(f"{path} is not a valid .{suffix} file ({reason}); {_EXPORT}") from error
    if not any(True for node in root.walk() if not isinstance(node, Group)):
        raise problems.empty(str(path), _NEEDS_MESH)
    Builder(problems).check(root)
    bounds = world_bounds(root)
    up = declared or guess_up(bounds, default=_Z_UP if suffix == "stl" else _Y_UP)
    scene = Scene(name=path.stem, up=up, views=as_views(cameras, bounds, problems))
    if type(root) is Group:
        root.name = path.stem
        scene.root = root
    else:
        scene.add(root)
    scene.problems.extend(problems.sentences())
    return scene


def _checked_suffix(path: Path) -> str:
    if path.is_dir():
        raise SceneError(f"{path} is a folder; name a file in it")
    if not path.exists():
        raise SceneError(f"{path} does not exist; check the name")
    name = path.name.lower()
    suffix = next((s for s in ("tar.gz", "tar.bz2") if name.endswith("." + s)), path.suffix.lower().lstrip("."))
    if suffix not in readable_suffixes():
        known = ", ".join(readable_suffixes())
        what = f"files that end in .{suffix} cannot be read" if suffix else "the name has no suffix"
        raise SceneError(f"{path}: {what}; convert it to one of: {known}")
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as error:
        raise SceneError(f"{path} cannot be read ({error.strerror}); check its permissions") from error
    if empty:
        raise SceneError(f"{path} is empty (0 bytes); {_NEEDS_MESH}")
    return suffix


def _read(path: Path, suffix: str) -> Any:
    refuse_short_text(path, suffix)
    # no processing: it would drop vertices that are not finite and merge vertices by an absolute tolerance
    return trimesh.load_scene(str(path), file_type=suffix, process=False)


def _declared_up(path: Path, suffix: str) -> tuple[float, float, float] | None:
    if suffix == "3mf":
        return _Z_UP
    if suffix == "dae":
        found = re.search(rb"<up_axis>\s*([XYZ])_UP", path.read_bytes())
        axis = found[1].decode() if found else "Y"  # the default of COLLADA
        return {"X": (1.0, 0.0, 0.0), "Y": _Y_UP, "Z": _Z_UP}[axis]
    return None


def guess_up(bounds: NDArray[np.float64], *, default: tuple[float, float, float] = _Y_UP) -> tuple[float, float, float]:
    """Which way is up in a file that does not say; only y and z are considered.

    In this order: coordinates far from the origin are map coordinates, which have z up; what stands exactly on the
    plane y = 0 or z = 0, but not on both, stands on the ground; a model much lower than it is deep (0.6 times) lies on
    its flat side; else `default`.

    Parameters
    ----------
    bounds : (2, 3) float
        World box.
    default : 3 floats
    """
    if far_offset(bounds, FLAT_FAR) is not None:
        return _Z_UP
    size = bounds[1] - bounds[0]
    on_ground = np.abs(bounds[0]) <= 1e-3 * size
    if on_ground[1] != on_ground[2] and size.min() > 0:
        return _Z_UP if on_ground[2] else _Y_UP
    if size[2] < 0.6 * size[1]:
        return _Z_UP
    if size[1] < 0.6 * size[2]:
        return _Y_UP
    return default
