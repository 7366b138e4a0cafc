"""OBJ: one drawable per object, with the colors of all its materials."""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..nodes import Group, Node
from . import problems as kinds
from .build import Builder, bounds_of, common_offset, node_of
from .files import Beside
from .materials import Look, Looks, as_rgba, rgba8
from .obj_text import ObjText, read_obj_text, repair_faces
from .problems import Problems

#: Color of faces without a material, in an object where others have one.
_NEUTRAL = (0.8, 0.8, 0.8, 1.0)


def load_obj(path: Path, problems: Problems) -> Group:
    """The objects of an OBJ file below one group, in the order of the file.

    An object is a single drawable. If it has several plain materials, their colors become vertex colors (vertices on a
    border between two materials are doubled); if one of its materials has a texture, the object becomes a group with
    one drawable per material.
    """
    obj = read_obj_text(path.read_bytes(), path.stem)
    geometry = _read(obj)
    for index, count in obj.dropped.items():
        problems.note(kinds.MISSING_VERTICES, obj.objects[index], str(count))
    looks = _materials(path, obj, problems)
    pieces: dict[int, list[tuple[str | None, Any]]] = defaultdict(list)
    for run, (index, material) in enumerate(obj.runs):
        if (found := geometry.get(str(run))) is not None:
            pieces[index].append((material, found))
    if not pieces and geometry:
        problems.note(kinds.NO_TRIANGLES, path.stem, f"{sum(len(g.vertices) for g in geometry.values())} points")
    boxes = [bounds_of(np.asarray(g.vertices)) for parts in pieces.values() for _, g in parts]
    shift = common_offset(np.array(boxes).reshape(-1, 2, 3))
    builder = Builder(problems, shift)
    nodes = [
        node
        for index, parts in sorted(pieces.items())
        if (node := _object(builder, obj.objects[index], parts, looks)) is not None
    ]
    matrix = None
    if shift is not None:
        matrix = np.eye(4)
        matrix[:3, 3] = shift
    return node_of(matrix, nodes, "origin" if shift is not None else path.stem)


def _read(obj: ObjText) -> dict[str, Any]:
    options: dict[str, Any] = {
        "process": False, "split_objects": True, "group_material": False, "skip_materials": True,
    }  # fmt: skip
    try:
        scene = trimesh.load_scene(io.BytesIO(obj.text.encode()), file_type="obj", **options)
    except IndexError:  # a face beyond the vertices, which only a slow pass over all faces can find
        repair_faces(obj)
        scene = trimesh.load_scene(io.BytesIO(obj.text.encode()), file_type="obj", **options)
    return dict(scene.geometry)


def _materials(path: Path, obj: ObjText, problems: Problems) -> dict[str, Look]:
    if not obj.libraries:
        return {}
    beside, looks, out = Beside(path), Looks(problems), {}
    parse: Any = trimesh.exchange.obj.parse_mtl  # without type information
    for line in obj.libraries:
        try:
            sources = [beside.get(line)]
        except FileNotFoundError:
            sources = []
            for name in line.split():
                try:
                    sources.append(beside.get(name))
                except FileNotFoundError:
                    problems.note("material files that are missing, objects kept without their colors", name)
        beside.missing.clear()
        for source in sources:
            for name, values in parse(source, resolver=beside).items():
                out[name] = _material(name, values, looks)
        for name in beside.missing:
            problems.note(kinds.NO_TEXTURE, name, "not found")
        beside.missing.clear()
    return out


def _material(name: str, values: dict[str, Any], looks: Looks) -> Look:
    color = as_rgba(values.get("diffuse"))
    try:
        alpha = float(values["d"][-1]) if "d" in values else 1.0 - float(values.get("tr", ["0"])[0])
    except ValueError:
        alpha = 1.0
    if color is not None:
        color = (*color[:3], min(max(alpha, 0.0), 1.0))
    image = values.get("image")
    texture = None if image is None else looks.image(image, name)
    # exporters often write Kd 0 0 0 beside a texture: the texture alone is the color
    return Look(color=None if texture is not None else color, texture=texture)


def _object(
    builder: Builder, name: str, parts: Sequence[tuple[str | None, Any]], looks: dict[str, Look]
) -> Node | None:
    named = [(material, looks.get(material or "", Look()), geometry) for material, geometry in parts]
    if len(named) > 1 and any(look.texture is not None for _, look, _ in named):
        nodes = [
            node
            for material, look, geometry in named
            if (node := _single(builder, f"{name}:{material or 'plain'}", look, geometry)) is not None
        ]
        return Group(*nodes, name=name) if nodes else None
    if len(named) == 1:
        return _single(builder, name, named[0][1], named[0][2])
    starts = np.cumsum([0] + [len(g.vertices) for _, _, g in named[:-1]])
    colors = None
    if len({look.color for _, look, _ in named}) > 1 or any(_vertex_colors(g) is not None for _, _, g in named):
        colors = np.concatenate([_expanded(look, g) for _, look, g in named])
    normals = [_normals(g) for _, _, g in named]
    known = [n for n in normals if n is not None]
    part = builder.part(
        np.concatenate([np.asarray(g.vertices) for _, _, g in named]),
        np.concatenate([np.asarray(g.faces) + s for (_, _, g), s in zip(named, starts, strict=True)]),
        name=name,
        look=Look(color=None if colors is not None else named[0][1].color, vertex_colors=colors),
        normals=np.concatenate(known) if len(known) == len(normals) else None,
    )
    return None if part is None else part.place(name)


def _single(builder: Builder, name: str, look: Look, geometry: Any) -> Node | None:
    uv = getattr(geometry.visual, "uv", None) if look.texture is not None else None
    look = replace(look, uv=uv, vertex_colors=_vertex_colors(geometry))
    part = builder.part(geometry.vertices, geometry.faces, name=name, look=look, normals=_normals(geometry))
    return None if part is None else part.place(name)


def _normals(geometry: Any) -> NDArray[np.float64] | None:
    return geometry.vertex_normals if "vertex_normals" in geometry._cache else None


def _vertex_colors(geometry: Any) -> NDArray[np.uint8] | None:
    return rgba8(geometry.visual.vertex_colors) if geometry.visual.kind == "vertex" else None


def _expanded(look: Look, geometry: Any) -> NDArray[np.uint8]:
    own = _vertex_colors(geometry)
    if own is not None and look.color is None:
        return own
    return np.repeat(rgba8(np.asarray(look.color or _NEUTRAL)), len(geometry.vertices), axis=0)
