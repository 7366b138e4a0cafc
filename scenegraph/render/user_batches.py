"""Many actors of a user drawn by one call, with the numbers that VTK draws them by one by one.

VTK spends 50 to 80 µs on each actor that it draws. What it does for an actor is repeated here for a batch: vertices
are shifted and scaled as `vtkOpenGLVertexBufferObject` does it, the matrices of each actor are multiplied in float64
and rounded once, as in `vtkOpenGLPolyDataMapper`, and a vertex looks up those of its actor, and its color, in a texture
of floats. So the same numbers reach the same arithmetic: calls of one actor each give VTK's picture bit for bit.

Longer calls do so nearly always. Mesa's software rasterizer draws a pixel or two in a million differently when a call
is long, or when it mixes triangles that are clipped with others; so calls are kept short, and batches are drawn only
where they are asked for.

Trap: VTK's frustum culler asks a batch for its bounds, and its vertices are in the coordinates of many actors. Two
triangles without extent give it the bounds of the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .actors import borrowed
from .layout import F32, F64, I32, I64, Mask, picked
from .user_looks import Shape, array_name, colors_of, look_of, shape_of

#: Fewer actors that look alike are not worth a batch.
_FEWEST = 4
#: Triangles of one call (measured with one sample per pixel in two cities: no pixel differs up to 340, up to two in a
#: frame from 1000 on).
_TOGETHER = 340
#: Texels of an item: to the display, to the eye, normals to the eye, color.
_TEXELS, _PER_LINE = 12, 64

_DECLARED = f"""//VTK::Normal::Dec
in float itemNumber;
uniform sampler2D itemTable;
flat out vec4 itemColor;
vec4 itemTexel(int which)
{{
  int item = int(itemNumber);
  return texelFetch(itemTable, ivec2((item % {_PER_LINE}) * {_TEXELS} + which, item / {_PER_LINE}), 0);
}}
"""
_PLACED = """
  mat4 itemToDisplay = mat4(itemTexel(0), itemTexel(1), itemTexel(2), itemTexel(3));
  mat4 itemToEye = mat4(itemTexel(4), itemTexel(5), itemTexel(6), itemTexel(7));
  itemColor = itemTexel(11);
  vertexVCVSOutput = itemToEye * vertexMC;
  gl_Position = itemToDisplay * vertexMC;
"""
_TURNED = """
  mat3 itemNormals = mat3(itemTexel(8).xyz, itemTexel(9).xyz, itemTexel(10).xyz);
  normalVCVSOutput = itemNormals * normalMC;
"""
_RECEIVED = """//VTK::Normal::Dec
flat in vec4 itemColor;
"""
#: Where the last number is 1, the vertices have colors of their own, and VTK has taken those already.
_COLORED = """//VTK::Color::Impl
  if (itemColor.a < 0.5)
  {
    ambientColor = ambientIntensity * itemColor.rgb;
    diffuseColor = diffuseIntensity * itemColor.rgb;
    specularColor = specularIntensity * itemColor.rgb;
    opacity = opacityUniform;
  }
"""


class UserBatches:
    """Batches of the actors of one renderer.

    Parameters
    ----------
    actors : sequence of vtkActor
        In the order in which they are drawn.
    allowed : (n,) bool
        Which of them may be in a batch.

    Attributes
    ----------
    label : (n,) int64
        Number of the batch that each actor is in, or -1.
    """

    def __init__(self, actors: Sequence[Any], allowed: Mask) -> None:
        self._actors = actors
        self.label: I64 = np.full(len(actors), -1)
        self._item: I64 = np.zeros(len(actors), np.int64)
        self._triangles: I64 = np.zeros(len(actors), np.int64)
        self._looks: list[tuple[Any, ...] | None] = [None] * len(actors)
        groups: dict[tuple[Any, ...], list[int]] = {}
        shapes: dict[Any, Shape | None] = {}
        shape_of_actor: dict[int, Shape] = {}
        for index in np.flatnonzero(allowed).tolist():
            actor = actors[index]
            look = look_of(actor)
            if look is None:
                continue
            mapper = actor.GetMapper()
            data = mapper.GetInputDataObject(0, 0)
            key = (data.GetAddressAsString(""), look[1], array_name(mapper))
            if key not in shapes:
                shapes[key] = shape_of(data, look[1], colors_of(mapper, data))
            shape = shapes[key]
            if shape is not None:
                groups.setdefault(look, []).append(index)
                shape_of_actor[index] = shape
                self._triangles[index] = len(shape.faces)
                self._looks[index] = _with_color(look, actor)
        self._batches: list[_Batch] = []
        for look, indices in groups.items():
            if len(indices) >= _FEWEST:
                self.label[indices] = len(self._batches)
                self._item[indices] = np.arange(len(indices))
                members = [actors[i] for i in indices]
                self._batches.append(_Batch(members, [shape_of_actor[i] for i in indices], look[1]))

    def has_changed(self, index: int) -> bool:
        """Whether a member does not look as it did when it came."""
        if self.label[index] < 0:
            return False
        look = look_of(self._actors[index])
        return look is None or _with_color(look, self._actors[index]) != self._looks[index]

    def leave(self, index: int) -> None:
        """Draw an actor on its own from now on."""
        self.label[index] = -1

    def runs(self, order: I64, renderer: Any) -> list[tuple[int, int, Any]]:
        """What is drawn instead of users' actors in the frame that begins.

        Where two surfaces are equally far away, what is drawn last is seen. So a batch is drawn in pieces, between the
        actors that are not in it.

        Parameters
        ----------
        order : (m,) int64
            Actors that are drawn, one after another; -1 for one that is unknown here.
        renderer : vtkRenderer

        Returns
        -------
        list of (first, end, vtkActor)
            Each stands for ``order[first:end]``.
        """
        labels = np.where(order >= 0, self.label[order], -1)
        if not (labels >= 0).any():
            return []
        drawn = np.cumsum(np.where(labels >= 0, self._triangles[order], 0)) // _TOGETHER
        new = (labels[1:] != labels[:-1]) | (drawn[1:] != drawn[:-1])
        starts = np.flatnonzero(np.concatenate([[True], new]))
        ends = np.append(starts[1:], len(order))
        lengths = ends - starts
        long = (lengths >= _FEWEST) & (labels[starts] >= 0)
        if not long.any():
            return []
        camera = renderer.GetActiveCamera()
        to_eye = _elements(camera.GetModelViewTransformMatrix())
        projection = _elements(camera.GetProjectionTransformMatrix(renderer.GetTiledAspectRatio(), -1, 1))
        to_display = _product(to_eye, projection)
        together = np.repeat(long, lengths)
        for number, batch in enumerate(self._batches):
            mine = order[together & (labels == number)]
            if len(mine):
                batch.place(self._item[mine], to_eye, to_display)
        found = []
        used = [0] * len(self._batches)
        for start, end in zip(starts[long].tolist(), ends[long].tolist(), strict=True):
            number = int(labels[start])
            found.append((start, end, self._batches[number].run(used[number], self._item[order[start:end]])))
            used[number] += 1
        return found

    def release(self, window: Any) -> None:
        """Give back what is loaded into the GPU."""
        if window is not None:
            for batch in self._batches:
                batch.release(window)


class _Batch:
    """Actors that share a look. Each has a line in the table, and its vertices know which."""

    def __init__(self, actors: Sequence[Any], shapes: Sequence[Shape], smooth: bool) -> None:
        from vtkmodules.vtkCommonDataModel import vtkImageData
        from vtkmodules.vtkRenderingCore import vtkProperty, vtkTexture

        self._smooth, self._n = smooth, len(shapes)
        models = np.array([_elements(a.GetMatrix()) for a in actors])
        self._places = _product(np.array([s.to_model for s in shapes]), models)
        self._turns = np.linalg.pinv(models[:, :3, :3]).transpose(0, 2, 1) if smooth else None
        counts = np.array([len(s.vertices) for s in shapes], np.int64)
        starts = np.cumsum(counts) - counts
        self._first = np.concatenate([[0], np.cumsum([len(s.faces) for s in shapes], dtype=np.int64)])
        self._faces = np.concatenate([s.faces for s in shapes])
        self._faces += np.repeat(starts, np.diff(self._first)).astype(np.int32)[:, None]
        ends = _world(shapes, models)
        vertices = np.concatenate([*(s.vertices for s in shapes), ends])
        self._ends = np.repeat(np.arange(2, dtype=np.int32) + len(vertices) - 2, 3)
        numbers = np.concatenate([np.repeat(np.arange(self._n), counts), [0, 0]]).astype(np.float32)
        self._arrays = {"vertices": borrowed(vertices), "itemNumber": borrowed(numbers)}
        self._arrays["itemNumber"].SetName("itemNumber")
        if smooth:
            normals = np.concatenate([*(s.normals for s in shapes if s.normals is not None), 0 * ends])
            self._arrays["normals"] = borrowed(normals)
        colored = np.array([s.colors is not None for s in shapes])
        if colored.any():
            white = np.full((int(counts.max()), 4), 255, np.uint8)
            parts = [white[:count] if s.colors is None else s.colors for s, count in zip(shapes, counts, strict=True)]
            self._arrays["colors"] = borrowed(np.concatenate([*parts, white[:1], white[:1]]))
        lines = -(-self._n // _PER_LINE)
        self._table = np.zeros((lines * _PER_LINE, _TEXELS, 4), np.float32)
        self._table[: self._n, 11, :3] = [a.GetProperty().GetDiffuseColor() for a in actors]
        self._table[: self._n][colored, 11, 3] = 1
        self._texels = borrowed(self._table.reshape(-1, 4))
        self._image = vtkImageData()
        self._image.SetDimensions(_PER_LINE * _TEXELS, lines, 1)
        self._image.GetPointData().SetScalars(self._texels)
        texture = vtkTexture()
        texture.SetInputData(self._image)
        texture.SetColorModeToDirectScalars()
        texture.InterpolateOff()
        texture.MipmapOff()
        texture.RepeatOff()
        self._style = vtkProperty()
        self._style.DeepCopy(actors[0].GetProperty())
        self._style.SetTexture("itemTable", texture)
        self._runs: list[_Run] = []
        self._seen = b""

    def place(self, items: I64, to_eye: F64, to_display: F64) -> None:
        """Write the matrices of these items for a view."""
        seen = to_display.tobytes() + to_eye.tobytes() + items.tobytes()
        if seen == self._seen:
            return
        self._seen = seen
        places = self._places[items]
        self._table[items, 0:4] = _product(places, to_display)
        self._table[items, 4:8] = _product(places, to_eye)
        if self._turns is not None:
            turned: F64 = np.asarray(np.linalg.inv(to_eye[:3, :3]).T, np.float64)
            self._table[items, 8:11, :3] = _product(self._turns[items], turned)
        self._texels.Modified()
        self._image.Modified()

    def run(self, number: int, items: I64) -> Any:
        """A `vtkActor` that draws these items; the runs of a frame have different numbers."""
        if number == len(self._runs):
            self._runs.append(_Run(self._arrays, self._style, self._smooth))
        run = self._runs[number]
        key = items.tobytes()
        if run.key != key:
            run.key = key
            chosen = np.zeros(self._n, bool)
            chosen[items] = True
            run.show(np.concatenate([self._ends, picked(self._faces, self._first, chosen)]))
        return run.actor

    def release(self, window: Any) -> None:
        for run in self._runs:
            run.actor.ReleaseGraphicsResources(window)


class _Run:
    """Some items of a batch as a `vtkActor`. VTK loads arrays that several mappers share only once."""

    def __init__(self, arrays: dict[str, Any], style: Any, smooth: bool) -> None:
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

        self.key = b""
        points, data, self._cells = vtkPoints(), vtkPolyData(), vtkCellArray()
        points.SetData(arrays["vertices"])
        data.SetPoints(points)
        data.SetPolys(self._cells)
        data.GetPointData().AddArray(arrays["itemNumber"])
        if smooth:
            data.GetPointData().SetNormals(arrays["normals"])
        if "colors" in arrays:
            data.GetPointData().SetScalars(arrays["colors"])
        mapper: Any = vtkPolyDataMapper()
        mapper.SetInputData(data)
        mapper.SetVBOShiftScaleMethod(0)
        mapper.SetScalarVisibility("colors" in arrays)
        mapper.SetColorModeToDirectScalars()
        mapper.MapDataArrayToVertexAttribute("itemNumber", "itemNumber", 0, -1)
        self.actor: Any = vtkActor()
        self.actor.SetMapper(mapper)
        self.actor.SetProperty(style)
        self.actor.ForceOpaqueOn()
        self.actor.PickableOff()
        shader = self.actor.GetShaderProperty()
        shader.AddVertexShaderReplacement("//VTK::Normal::Dec", True, _DECLARED, False)
        shader.AddVertexShaderReplacement("//VTK::PositionVC::Impl", True, _PLACED, False)
        if smooth:
            shader.AddVertexShaderReplacement("//VTK::Normal::Impl", True, _TURNED, False)
        shader.AddFragmentShaderReplacement("//VTK::Normal::Dec", True, _RECEIVED, False)
        shader.AddFragmentShaderReplacement("//VTK::Color::Impl", True, _COLORED, False)

    def show(self, indices: I32) -> None:
        self._lent = borrowed(indices)
        self._cells.SetData(3, self._lent)
        self._cells.Modified()


def _with_color(look: tuple[Any, ...], actor: Any) -> tuple[Any, ...]:
    return (*look, actor.GetProperty().GetDiffuseColor())


def _world(shapes: Sequence[Shape], models: F64) -> F32:
    """(2, 3) corners of a box around all items."""
    low, high = np.array([s.low for s in shapes]), np.array([s.high for s in shapes])
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    center = np.einsum("ki,kij->kj", middle, models[:, :3, :3]) + models[:, 3, :3]
    reach = np.einsum("ki,kij->kj", half, np.abs(models[:, :3, :3]))
    ends = np.stack([(center - reach).min(axis=0), (center + reach).max(axis=0)])
    slack = 1e-6 * np.abs(ends).max() + 1e-3 * np.ptp(ends, axis=0).max()
    return np.asarray(ends + [[-slack], [slack]], np.float32)


def _elements(matrix: Any) -> F64:
    """(4, 4) of a `vtkMatrix4x4`, transposed: VTK multiplies rows from the left."""
    values = [0.0] * 16
    matrix.DeepCopy(values, matrix)
    return np.array(values).reshape(4, 4).T


def _product(first: F64, second: F64) -> F64:
    """Matrices multiplied, and the sums rounded, in the order of `vtkMatrix4x4`: BLAS has another one.

    A last bit in float64 is enough to round a few of a million numbers differently to float32, and to show in a pixel.
    """
    out = first[..., :, 0:1] * second[..., 0:1, :]
    for i in range(1, first.shape[-1]):
        out = out + first[..., :, i : i + 1] * second[..., i : i + 1, :]
    return np.asarray(out)
