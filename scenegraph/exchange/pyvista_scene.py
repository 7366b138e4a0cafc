"""pyvista plotters, multi-blocks and data sets as graphs."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..mesh import Color
from ..nodes import Geode, Group, Node, Switch, Transform
from ..scene import Scene
from ..view import View
from . import problems as kinds
from .build import Builder, Part, bounds_of, common_offset, node_of
from .problems import Problems
from .vtk_data import (
    Surface,
    children_of,
    field_color,
    mapped_colors,
    own_colors,
    surface_of,
    texture_of,
    vtk_module,
)

_FLAT = 0  # VTK_FLAT
_IDENTITY = tuple(np.eye(4).ravel().tolist())
#: What pyvista puts into the names of actors that were given none: another one in every run.
_ADDRESS = re.compile(r"\((?:Addr=)?0x[0-9a-fA-F]+\)")


def from_pyvista(source: Any, *, name: str = "scene") -> Scene:
    """A scene of what pyvista or VTK holds.

    * A `Plotter` (its active renderer) or `vtkRenderer`: one drawable per actor, at the place that the actor's user
      matrix, position, orientation, scale and origin give it, with its color, opacity, mapped scalars and texture.
      Actors that show the same data in the same colors share a `Mesh`. An invisible actor is below a `Switch` that is
      off. `Geode.source` is the actor. The camera becomes the view "camera".
    * A `MultiBlock`: one group per block, one drawable per data set; `Geode.source` is the data set.
    * A data set: one drawable. Grids and volumes give their outer surface; polygons are triangulated.

    Parameters
    ----------
    source : pyvista.Plotter, vtkRenderer, pyvista.MultiBlock or pyvista.DataSet
    name : str

    Returns
    -------
    Scene
        `Scene.problems` says what was left out.

    Raises
    ------
    SceneError
        Nothing to draw, or something else than these objects.
    """
    problems = Problems()
    renderer = getattr(source, "renderer", source)
    items: list[_Item] = []
    views: dict[str, View] = {}
    background: Sequence[float] | None = None
    if hasattr(renderer, "GetViewProps"):
        if (others := len(getattr(source, "renderers", ())) - 1) > 0:
            problems.say(f"{others} other subplots are left out; make one active to import it")
        items = _actors(renderer, problems)
        background = renderer.GetBackground()
        camera = renderer.GetActiveCamera()
        width, height = renderer.GetSize()
        if not (width and height):  # nothing has been drawn yet
            width, height = getattr(source, "window_size", (1024, 768))
        try:
            views["camera"] = View.from_vtk(camera, width, height)
        except SceneError as error:
            problems.note("cameras that cannot be used, left out", "camera", str(error))
    elif hasattr(source, "IsA") and source.IsA("vtkDataObject"):
        items = _data(source, name, ())
    else:
        raise SceneError(f"from_pyvista got {type(source).__name__}; give a pyvista Plotter, MultiBlock or data set")
    root = _graph(items, problems, name)
    if not any(isinstance(node, Geode) for node in root.walk()):
        raise problems.empty(f"the pyvista scene {name!r}", "add a mesh with faces")
    Builder(problems).check(root)
    scene = Scene(name=name, views=views)
    if background is not None:
        scene.background = (float(background[0]), float(background[1]), float(background[2]))
    if type(root) is Group:
        scene.root = root
    else:
        scene.add(root)
    scene.problems.extend(problems.sentences())
    return scene


@dataclass(frozen=True)
class _Item:
    """One drawable to be: data, where it stands, how it looks."""

    name: str
    data: Any
    #: Identity, name and matrix of the groups above it, from the root down.
    above: tuple[tuple[object, str, NDArray[np.float64] | None], ...]
    source: object
    texture: NDArray[np.uint8] | None = None
    color: Color | None = None
    colors: NDArray[np.uint8] | None = None
    cell_colors: bool = False
    normals: bool = True
    visible: bool = True


def _graph(items: list[_Item], problems: Problems, name: str) -> Group:
    surfaces: dict[object, Surface] = {}
    keys = []
    for item in items:
        colors = None if item.colors is None else hashlib.sha256(item.colors.tobytes()).digest()
        key = (_address(item.data), colors, item.cell_colors, item.normals, id(item.texture))
        keys.append(key)
        if key not in surfaces:
            surfaces[key] = surface_of(
                item.data, colors=item.colors, cell_colors=item.cell_colors, normals=item.normals
            )
    flat = all(matrix is None for item in items for _, _, matrix in item.above)
    boxes = [bounds_of(s.vertices) for s in surfaces.values() if len(s.faces)]
    shift = common_offset(np.array(boxes)) if flat and boxes else None
    builder = Builder(problems, shift)
    parts: dict[object, Part | None] = {}
    root = Group(name=name) if shift is None else Transform(name="origin", translation=shift)
    groups: dict[object, Group] = {}
    for item, key in zip(items, keys, strict=True):
        if key not in parts:
            parts[key] = _part(builder, item, surfaces[key], problems)
        parent = root
        for identity, label, matrix in item.above:
            if identity not in groups:
                groups[identity] = node_of(matrix, (), label)
                parent.add(groups[identity])
            parent = groups[identity]
        part = parts[key]
        if part is None:
            continue
        node: Node = part.place(item.name, color=item.color, source=item.source)
        parent.add(node if item.visible else Switch(node, active="none", name=f"{item.name} (hidden)"))
    return root


def _part(builder: Builder, item: _Item, surface: Surface, problems: Problems) -> Part | None:
    if not len(surface.faces):
        count = len(surface.vertices)
        problems.note(kinds.NO_TRIANGLES, item.name, f"{type(item.data).__name__} of {count} points")
        return None
    look = replace(surface.look, texture=item.texture)
    return builder.part(surface.vertices, surface.faces, name=item.name, look=look, normals=surface.normals)


def _data(data: Any, name: str, above: tuple[Any, ...]) -> list[_Item]:
    if data.IsA("vtkCompositeDataSet"):
        out = []
        for label, block in children_of(data):
            deeper = block.IsA("vtkCompositeDataSet")
            out += _data(block, label, (*above, (object(), label, None)) if deeper else above)
        return out
    if not data.IsA("vtkDataSet"):
        return []
    colors, per_cell = own_colors(data)
    return [_Item(name, data, above, data, colors=colors, cell_colors=per_cell, color=field_color(data))]


def _actors(renderer: Any, problems: Problems) -> list[_Item]:
    named = getattr(renderer, "actors", None)  # a property of every VTK renderer, but a mapping in pyvista
    names = {_address(a): str(label) for label, a in named.items()} if isinstance(named, Mapping) else {}
    out: list[_Item] = []
    # not by number: VTK counts from the first one each time
    for index, prop in enumerate(renderer.GetViewProps()):
        name = _ADDRESS.sub("", names.get(_address(prop), prop.GetClassName()))
        if name != names.get(_address(prop)):
            name = f"{name} {index}"
        out += _prop(prop, name, (), True, problems)
    return out


def _prop(prop: Any, name: str, above: tuple[Any, ...], visible: bool, problems: Problems) -> list[_Item]:
    visible = visible and bool(prop.GetVisibility())
    if prop.IsA("vtkAssembly"):
        parts = prop.GetParts()
        inside = (*above, (object(), name, _matrix(prop)))
        return [
            item
            for i in range(parts.GetNumberOfItems())
            for item in _prop(parts.GetItemAsObject(i), f"{name} {i}", inside, visible, problems)
        ]
    if prop.IsA("vtkVolume"):
        problems.note(kinds.NO_TRIANGLES, name, "volume")
        return []
    mapper = prop.GetMapper() if prop.IsA("vtkActor") else None
    if mapper is None:  # texts, axes, scalar bars: drawn beside the scene, not in it
        return []
    if (algorithm := mapper.GetInputAlgorithm()) is not None:
        algorithm.Update()
    data = mapper.GetInputDataObject(0, 0)
    if data is None or mapper.IsA("vtkGlyph3DMapper"):
        problems.note(kinds.NO_TRIANGLES, name, mapper.GetClassName())
        return []
    matrix = _matrix(prop)
    if matrix is not None and matrix[3].tolist() != [0, 0, 0, 1]:
        problems.note(kinds.PROJECTIVE, name)
        return []
    if matrix is not None:
        above = (*above, (object(), name, matrix))
    if not data.IsA("vtkCompositeDataSet"):
        return [_drawn(prop, mapper, data, name, above, visible)]
    if matrix is None:
        above = (*above, (object(), name, None))
    return _blocks(prop, mapper, data, above, visible)


def _blocks(prop: Any, mapper: Any, data: Any, above: tuple[Any, ...], visible: bool) -> list[_Item]:
    attributes = mapper.GetCompositeDataDisplayAttributes() if mapper.IsA("vtkCompositePolyDataMapper") else None
    out: list[_Item] = []
    for label, block in children_of(data):
        shown = visible
        if attributes is not None and attributes.HasBlockVisibility(block):
            shown = shown and bool(attributes.GetBlockVisibility(block))
        if block.IsA("vtkCompositeDataSet"):
            out += _blocks(prop, mapper, block, (*above, (object(), label, None)), shown)
            continue
        item = _drawn(prop, mapper, block, label, above, shown)
        if attributes is not None and attributes.HasBlockColor(block):
            color = attributes.GetBlockColor(block)
            opacity = prop.GetProperty().GetOpacity()
            item = replace(item, color=_color([color[i] for i in range(3)], opacity))
        if attributes is not None and attributes.HasBlockOpacity(block) and item.color is not None:
            item = replace(item, color=_color(item.color, attributes.GetBlockOpacity(block)))
        out.append(item)
    return out


def _drawn(prop: Any, mapper: Any, data: Any, name: str, above: tuple[Any, ...], visible: bool) -> _Item:
    style = prop.GetProperty()
    opacity = style.GetOpacity()
    colors, per_cell = mapped_colors(mapper, data)
    if colors is not None and opacity < 1:
        colors = colors.copy()
        colors[:, 3] = np.rint(colors[:, 3] * opacity)
    texture = texture_of(prop)
    return _Item(
        name,
        data,
        above,
        prop,
        texture=texture,
        color=None if colors is not None or texture is not None else _color(style.GetColor(), opacity),
        colors=colors,
        cell_colors=per_cell,
        normals=style.GetInterpolation() != _FLAT,
        visible=visible,
    )


def _color(rgb: Sequence[float], opacity: float) -> Color:
    r, g, b, a = (min(max(float(c), 0.0), 1.0) if math.isfinite(c) else 0.0 for c in (*rgb[:3], opacity))
    return (r, g, b, a)


def _address(thing: Any) -> str:
    return str(thing.GetAddressAsString(""))


def _matrix(prop: Any) -> NDArray[np.float64] | None:
    matrix = vtk_module("vtkCommonMath").vtkMatrix4x4()
    prop.GetMatrix(matrix)
    values = matrix.GetData()
    return None if values == _IDENTITY else np.array(values).reshape(4, 4)
