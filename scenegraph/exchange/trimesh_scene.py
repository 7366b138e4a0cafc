"""trimesh scenes and meshes as graphs, and back."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..errors import SceneError
from ..mesh import Color, Mesh
from ..nodes import Geode, Group, Lod, Node, Switch, Transform
from ..scene import Scene
from . import problems as kinds
from .build import Builder, Part, bounds_of, common_offset, node_of, world_bounds
from .cameras import FileCamera, as_views, from_trimesh_camera, to_trimesh_camera
from .materials import Looks, to_visual
from .problems import Problems, quiet_trimesh


def from_trimesh(source: Any, *, name: str = "scene") -> Scene:
    """A scene of what trimesh holds.

    Geometry that several nodes show becomes one shared `Mesh`. Vertices are neither merged nor reordered, except that a
    mesh that shares no vertex at all gets equal ones merged, exactly. `Geode.source` is the name of the trimesh node,
    or the mesh itself if there are no nodes. A camera becomes a view.

    Parameters
    ----------
    source : trimesh.Scene, trimesh.Trimesh, or a list of Trimesh
    name : str

    Returns
    -------
    Scene
        `Scene.problems` says what was odd.

    Raises
    ------
    SceneError
        Nothing to draw, or something else than trimesh objects.
    """
    problems = Problems()
    cameras: list[FileCamera] = []
    with quiet_trimesh(problems):
        if isinstance(source, trimesh.Scene):
            root, cameras = graph_of(source, problems, name)
        else:
            root = _graph_of_list([source] if isinstance(source, trimesh.parent.Geometry) else source, problems, name)
    if not any(isinstance(node, Geode) for node in root.walk()):
        raise problems.empty(f"the trimesh scene {name!r}", "add a mesh with faces")
    Builder(problems).check(root)
    scene = Scene(name=name, views=as_views(cameras, world_bounds(root), problems))
    if type(root) is Group:
        scene.root = root
    else:
        scene.add(root)
    scene.problems.extend(problems.sentences())
    return scene


def graph_of(source: trimesh.Scene, problems: Problems, name: str) -> tuple[Group, list[FileCamera]]:
    """The node tree of a trimesh scene below one group, and its camera.

    If no node moves anything and the coordinates are far from the origin, the group is a `Transform` with one common
    offset.
    """
    forest = source.graph.transforms
    matrices = {edge: data.get("matrix", np.eye(4)) for edge, data in forest.edge_data.items()}
    flat = all(np.array_equal(m, np.eye(4)) for m in matrices.values())
    geometries = dict(source.geometry)
    parts, shift = _parts(geometries, {key: str(key) for key in geometries}, flat, problems)
    base = source.graph.base_frame
    camera_node = source.camera.name if source.has_camera else None
    cameras: list[FileCamera] = []
    children: dict[Any, list[Any]] = forest.children
    order: list[Any] = []
    worlds = {base: np.eye(4)}
    stack = [base]
    while stack:
        frame = stack.pop()
        order.append(frame)
        for child in children.get(frame, ()):
            with np.errstate(all="ignore"):
                worlds[child] = worlds[frame] @ matrices[frame, child]
        stack.extend(reversed(children.get(frame, ())))
    if camera_node in worlds:
        cameras.append(from_trimesh_camera(source, worlds[camera_node]))
    made: dict[Any, Node] = {}
    nodes: list[Node] = []
    placed: set[Any] = set()
    for frame in reversed(order):
        geometry = forest.node_data[frame].get("geometry")
        placed.add(geometry)
        below = [made[c] for c in children.get(frame, ()) if c in made]
        if frame == camera_node and not below and geometry is None:
            continue
        own = [parts[geometry].place(str(frame), source=frame)] if geometry in parts else []
        if frame == base:  # the last one
            nodes = [*own, *below]
            break
        matrix = matrices[forest.parents[frame], frame]
        if own and not below and np.array_equal(matrix, np.eye(4)):
            made[frame] = own[0]
        elif not np.array_equal(matrix[3], (0, 0, 0, 1)):
            problems.note(kinds.PROJECTIVE, str(frame))
        else:
            made[frame] = node_of(matrix, [*own, *below], str(frame))
    for frame, data in forest.node_data.items():
        if frame not in worlds and "geometry" in data:
            problems.note("nodes that are not connected to the base frame, left out", str(frame))
            placed.add(data["geometry"])
    for key in parts.keys() - placed:
        problems.note(kinds.UNPLACED, str(key))
    return _below(shift, nodes, name), cameras


def _graph_of_list(source: Iterable[Any], problems: Problems, name: str) -> Group:
    try:
        items = list(source.items() if isinstance(source, dict) else enumerate(source))
    except TypeError:
        items = [(0, source)]
    for _, item in items:
        if not isinstance(item, trimesh.parent.Geometry) or isinstance(item, trimesh.Scene):
            raise SceneError(
                f"from_trimesh got {type(item).__name__}; give a trimesh.Scene, a trimesh.Trimesh or a list of Trimesh"
            )
    labels = [k if isinstance(k, str) else str(item.metadata.get("name") or f"mesh {k}") for k, item in items]
    known = {id(item): item for _, item in items}
    first = {id(item): label for (_, item), label in zip(reversed(items), reversed(labels), strict=True)}
    parts, shift = _parts(known, first, True, problems)
    nodes = [
        parts[id(item)].place(label, source=item)
        for (_, item), label in zip(items, labels, strict=True)
        if id(item) in parts
    ]
    return _below(shift, nodes, name)


def _below(shift: NDArray[np.float64] | None, nodes: Sequence[Node], name: str) -> Group:
    if shift is None:
        return Group(*nodes, name=name)
    return Transform(*nodes, translation=shift, name="origin")


def _parts(
    geometries: dict[Any, Any], labels: dict[Any, str], flat: bool, problems: Problems
) -> tuple[dict[Any, Part], NDArray[np.float64] | None]:
    drawn = {}
    for key, geometry in geometries.items():
        label = labels[key]
        if isinstance(geometry, trimesh.Trimesh):
            drawn[key] = label
        else:
            count = len(getattr(geometry, "vertices", ()))
            problems.note(kinds.NO_TRIANGLES, label, f"{type(geometry).__name__} of {count} points")
    shift = None
    if flat and drawn:
        shift = common_offset(np.array([bounds_of(np.asarray(geometries[key].vertices)) for key in drawn]))
    builder, looks = Builder(problems, shift), Looks(problems)
    parts = {}
    for key, label in drawn.items():
        geometry = geometries[key]
        normals = geometry.vertex_normals if "vertex_normals" in geometry._cache else None
        part = builder.part(
            np.asarray(geometry.vertices), np.asarray(geometry.faces),
            name=label, look=looks.of(geometry, label), normals=normals,
        )  # fmt: skip
        if part is not None:
            parts[key] = part
    return parts, shift


def to_trimesh(scene: Scene) -> trimesh.Scene:
    """The same hierarchy as a `trimesh.Scene`; meshes that are shared stay shared.

    Levels of detail are exported with their finest level, switches with their active children; occluders are left out.
    A transform or group with a single geode of its own name is one trimesh node. The first perspective view becomes the
    camera.

    Returns
    -------
    trimesh.Scene
        Its matrices are exactly those of the graph (trimesh's repair of almost rigid ones is switched off). Where
        trimesh multiplies them along a path, it leaves out those that differ from the identity by less than 1e-8.
    """
    out = trimesh.Scene()
    graph: Any = out.graph  # without type information
    graph.repair_rigid = None
    names: dict[str, int] = {str(graph.base_frame): 1}
    geometries: dict[tuple[int, Color | None], str] = {}
    keys: dict[str, int] = {}
    base = graph.base_frame
    stack: list[tuple[Node, Any]] = [(scene.root, None)]
    while stack:
        node, parent = stack.pop()
        matrix = node.matrix if isinstance(node, Transform) else np.eye(4)
        at_base = parent is None and np.array_equal(matrix, np.eye(4)) and isinstance(node, Group)
        frame = base if at_base else unique(node.name or type(node).__name__, names)
        below = _shown(node)
        drawn: Geode | None = node if isinstance(node, Geode) else None
        if isinstance(node, Lod):
            drawn = node.levels[0]
        elif len(below) == 1 and isinstance(below[0], Geode) and below[0].name == node.name:
            drawn, below = below[0], []
        if not at_base:
            link: dict[str, Any] = {"matrix": matrix}
            if drawn is not None:
                link["geometry"] = _geometry(out, drawn, geometries, keys)
            graph.update(frame_to=frame, frame_from=base if parent is None else parent, **link)
        elif drawn is not None:
            below = [drawn]
        stack.extend((child, frame) for child in reversed(below))
    for name, view in scene.views.items():
        if not view.is_parallel:
            out.camera, out.camera_transform = to_trimesh_camera(view, unique(name, names))
            break
    return out


def _shown(node: Node) -> list[Node]:
    if isinstance(node, Switch):
        children = node.active_children()
    else:
        children = list(node) if isinstance(node, Group) else []
    return [c for c in children if isinstance(c, (Group, Geode, Lod))]


def _geometry(
    out: trimesh.Scene, geode: Geode, known: dict[tuple[int, Color | None], str], keys: dict[str, int]
) -> str:
    mesh, color = geode.mesh, geode.color or geode.mesh.color
    key = (id(mesh), geode.color)
    if key not in known:
        known[key] = unique(mesh.name or geode.name or "mesh", keys)
        out.geometry[known[key]] = as_trimesh(mesh, color)
    return known[key]


def as_trimesh(mesh: Mesh, color: Color | None) -> trimesh.Trimesh:
    """One mesh, unprocessed."""
    return trimesh.Trimesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        vertex_normals=mesh.normals,
        visual=to_visual(color, mesh.uv, mesh.vertex_colors, mesh.texture),
        process=False,
    )


def unique(name: str, taken: dict[str, int]) -> str:
    """`name`, or `name_2`, `name_3`, ... if it is taken; marks it as taken."""
    candidate = name
    while candidate in taken:
        taken[name] = taken.get(name, 1) + 1
        candidate = f"{name}_{taken[name]}"
    taken[candidate] = 1
    return candidate
