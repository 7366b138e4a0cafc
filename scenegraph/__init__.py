"""A workbench for visibility culling: a scene graph, pluggable stages, exact truth to judge them by."""

from __future__ import annotations

from .errors import GLError, PipelineError, SceneError, ScenegraphError, SuiteError
from .frame import Frame, StandIn
from .hookspecs import hookimpl
from .log import FrameLog, FrameRecord, StageRecord
from .mesh import Mesh, MeshTable
from .nodes import Geode, Group, Lod, Node, Switch, Transform
from .occluder import Occluder
from .occluders import OccluderTable
from .overlay import Faces, Lines, Overlay
from .pipeline import Pipeline
from .products import LevelOfVisibility
from .registry import Registry, registry
from .scene import Scene
from .snapshot import Snapshot
from .stage import Guarantee, Parameter, Stage, parameter
from .traversal import IN, OUT, PARTIAL, Batch
from .view import View

__version__ = "0.1.0"

__all__ = [
    "IN",
    "OUT",
    "PARTIAL",
    "Batch",
    "Faces",
    "Frame",
    "FrameLog",
    "FrameRecord",
    "GLError",
    "Geode",
    "Group",
    "Guarantee",
    "LevelOfVisibility",
    "Lines",
    "Lod",
    "Mesh",
    "MeshTable",
    "Node",
    "Occluder",
    "OccluderTable",
    "Overlay",
    "Parameter",
    "Pipeline",
    "PipelineError",
    "Registry",
    "Scene",
    "SceneError",
    "ScenegraphError",
    "Snapshot",
    "Stage",
    "StageRecord",
    "StandIn",
    "SuiteError",
    "Switch",
    "Transform",
    "View",
    "hookimpl",
    "parameter",
    "registry",
]
