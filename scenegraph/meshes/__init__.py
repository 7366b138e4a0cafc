"""What is derived from meshes: fitted occluders, coarser levels, HLOD trees, and the disk cache for all."""

from __future__ import annotations

from .cache import DiskCache, cache_folder
from .fitted import FittedOccluder, FittedOccluders
from .fitting import fit_occluders
from .hlod import hlod_of
from .hlod_tree import Hlod, HlodReport
from .inner import inner_shell
from .levels import SceneLevels, levels_for
from .placing import MeshOccluders, PlacedOccluders, SceneOccluders, occluders_for
from .simplification import level_chain, simplify
from .tessellation import tessellate, tessellated_triangles, tessellation_chain

__all__ = [
    "DiskCache",
    "FittedOccluder",
    "FittedOccluders",
    "Hlod",
    "HlodReport",
    "MeshOccluders",
    "PlacedOccluders",
    "SceneLevels",
    "SceneOccluders",
    "cache_folder",
    "fit_occluders",
    "hlod_of",
    "inner_shell",
    "level_chain",
    "levels_for",
    "occluders_for",
    "simplify",
    "tessellate",
    "tessellated_triangles",
    "tessellation_chain",
]
