"""What is derived from meshes: occluders fitted into them, HLOD trees, and the disk cache that keeps such data."""

from __future__ import annotations

from .cache import DiskCache, cache_folder
from .fitted import FittedOccluder, FittedOccluders
from .fitting import fit_occluders
from .hlod import Hlod, HlodReport, hlod_of
from .placing import MeshOccluders, PlacedOccluders, SceneOccluders, occluders_for

__all__ = [
    "DiskCache",
    "FittedOccluder",
    "FittedOccluders",
    "Hlod",
    "HlodReport",
    "MeshOccluders",
    "PlacedOccluders",
    "SceneOccluders",
    "cache_folder",
    "fit_occluders",
    "hlod_of",
    "occluders_for",
]
