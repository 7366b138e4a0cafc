"""What is derived from meshes: occluders fitted into them, and the disk cache that keeps such data."""

from __future__ import annotations

from .cache import DiskCache, cache_folder
from .fitted import FittedOccluder, FittedOccluders
from .fitting import fit_occluders
from .inner import inner_shell
from .placing import MeshOccluders, PlacedOccluders, SceneOccluders, occluders_for

__all__ = [
    "DiskCache",
    "FittedOccluder",
    "FittedOccluders",
    "MeshOccluders",
    "PlacedOccluders",
    "SceneOccluders",
    "cache_folder",
    "fit_occluders",
    "inner_shell",
    "occluders_for",
]
