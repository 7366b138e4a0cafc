"""Files, trimesh and pyvista: scenes come in and go out here.

`load` reads a model file; `from_trimesh` and `from_pyvista` take objects of those libraries, `to_trimesh` and
`to_multiblock` give them back. Everything is validated once, on the way in: what cannot be used raises `SceneError`
with the cure, what is odd but can be kept is counted and named in `Scene.problems`.
"""

from __future__ import annotations

from .load import load, readable_suffixes
from .multiblock import to_multiblock
from .pyvista_scene import from_pyvista
from .trimesh_scene import from_trimesh, to_trimesh

__all__ = ["from_pyvista", "from_trimesh", "load", "readable_suffixes", "to_multiblock", "to_trimesh"]
