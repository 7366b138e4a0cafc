"""Colors and textures: what trimesh keeps in its `visual` objects, as the arrays of a `Mesh`, and back.

Color values are taken as the file has them; no conversion between linear and sRGB happens. Texture coordinates have
their origin at the lower left, as in OBJ, trimesh and VTK (row 0 of the image is at v = 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..mesh import Color
from . import problems as kinds
from .problems import Problems

#: What trimesh reports for an OBJ material without a Kd line.
_TRIMESH_GRAY = (102, 102, 102, 255)


@dataclass(frozen=True)
class Look:
    """Base color, and what may override it."""

    color: Color | None = None
    uv: NDArray[np.float32] | None = None
    vertex_colors: NDArray[np.uint8] | None = None
    face_colors: NDArray[np.uint8] | None = None
    texture: NDArray[np.uint8] | None = None


def rgba8(values: ArrayLike) -> NDArray[np.uint8]:
    """(n, 4) uint8 of (n, 3 or 4) colors: floats are 0..1, 16-bit values 0..65535, other integers 0..255."""
    colors: NDArray[Any] = np.atleast_2d(np.asarray(values))
    if colors.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            colors = np.rint(np.clip(np.nan_to_num(colors), 0.0, 1.0) * 255)
    elif colors.dtype == np.uint16:
        colors = np.rint(colors / 257.0)
    if colors.shape[1] == 3:
        colors = np.column_stack([colors, np.full(len(colors), 255, np.uint8)])
    # bytes need no clipping: VTK hands them over by the thousand
    return colors.copy() if colors.dtype == np.uint8 else np.asarray(np.clip(colors, 0, 255), np.uint8)


def as_rgba(value: Any) -> Color | None:
    """RGBA in 0..1 of one color in any of trimesh's forms; None if it is not a color."""
    if value is None:
        return None
    array = np.asarray(value)
    if array.shape not in ((3,), (4,)) or array.dtype.kind not in "iuf":
        return None
    if array.dtype.kind == "f":
        array = np.clip(np.nan_to_num(array.astype(np.float64)), 0.0, 1.0)
    else:
        array = array / 255.0
    r, g, b, a = (*array.tolist(), 1.0)[:4]
    return (r, g, b, a)


class Looks:
    """Reads looks and keeps every image as one array, however many meshes show it."""

    def __init__(self, problems: Problems) -> None:
        self.problems = problems
        self._images: dict[tuple[int, bool], tuple[Any, NDArray[np.uint8] | None]] = {}

    def image(self, image: Any, name: str, *, keep_alpha: bool = True) -> NDArray[np.uint8] | None:
        """(h, w, 3 or 4) uint8 of a PIL image, or None and a remark if it is broken."""
        key = (id(image), keep_alpha)
        if key not in self._images:  # the image is kept beside its array so that its id stays taken
            try:
                alpha = keep_alpha and ("A" in image.getbands() or "transparency" in image.info)
                array = np.array(image.convert("RGBA" if alpha else "RGB"))
                array.flags.writeable = False
                self._images[key] = (image, array)
            except Exception as error:  # PIL decodes late, and with whatever the decoder raises
                self.problems.note(kinds.NO_TEXTURE, name, str(error).splitlines()[0] if str(error) else "")
                self._images[key] = (image, None)
        return self._images[key][1]

    def of(self, geometry: Any, name: str) -> Look:
        """The look of a `trimesh.Trimesh`."""
        visual = getattr(geometry, "visual", None)
        kind = getattr(visual, "kind", None)
        if visual is None or kind is None:
            return Look()
        if kind == "vertex":
            return plain_if_equal(Look(vertex_colors=rgba8(visual.vertex_colors)))
        if kind == "face":
            return plain_if_equal(Look(face_colors=rgba8(visual.face_colors)))
        look = self.of_material(visual.material, name)
        per_face = getattr(visual, "face_materials", None)
        if per_face is not None and hasattr(visual.material, "materials"):
            palette = [as_rgba(m.main_color) or (1.0, 1.0, 1.0, 1.0) for m in visual.material.materials]
            look = replace(plain_if_equal(Look(face_colors=rgba8(palette)[np.asarray(per_face)])), texture=None)
        uv = None if visual.uv is None else np.asarray(visual.uv, np.float32)
        colors = getattr(visual, "vertex_attributes", {}).get("color")
        return replace(
            look,
            uv=uv[:, :2] if uv is not None and uv.ndim == 2 and len(uv) == len(geometry.vertices) else None,
            vertex_colors=None if colors is None else rgba8(np.asarray(colors)),
        )

    def of_material(self, material: Any, name: str) -> Look:
        """The look of a trimesh material: `PBRMaterial`, `SimpleMaterial`, or the first of several."""
        if getattr(material, "materials", None):
            material = material.materials[0]
        label = str(getattr(material, "name", None) or name)
        if hasattr(material, "baseColorFactor"):
            keep_alpha = material.alphaMode in ("MASK", "BLEND")
            color, image = as_rgba(material.baseColorFactor), material.baseColorTexture
            if color is not None and not keep_alpha:
                color = (*color[:3], 1.0)
        else:
            keep_alpha = True
            diffuse, image = getattr(material, "diffuse", None), getattr(material, "image", None)
            color = None if diffuse is None or tuple(diffuse) == _TRIMESH_GRAY else as_rgba(diffuse)
        texture = None if image is None else self.image(image, label, keep_alpha=keep_alpha)
        return Look(color=color, texture=texture)


def plain_if_equal(look: Look) -> Look:
    """One base color where all vertices or faces have the same."""
    colors = look.vertex_colors if look.vertex_colors is not None else look.face_colors
    if colors is None or not len(colors) or (colors != colors[0]).any():
        return look
    return Look(color=as_rgba(colors[0]))


def to_visual(
    color: Sequence[float] | None,
    uv: NDArray[np.float32] | None,
    vertex_colors: NDArray[np.uint8] | None,
    texture: NDArray[np.uint8] | None,
) -> Any:
    """A trimesh visual of the same look, or None if the mesh has none."""
    import trimesh

    visuals: Any = trimesh.visual  # partly without type information
    if texture is None and vertex_colors is not None:
        return visuals.ColorVisuals(vertex_colors=vertex_colors)
    if texture is None and color is None:
        return None
    image = None
    if texture is not None:
        from PIL import Image

        image = Image.fromarray(texture)
    see_through = (texture is not None and texture.shape[2] == 4) or (color is not None and color[3] < 1)
    material = visuals.material.PBRMaterial(
        baseColorFactor=None if color is None else rgba8(np.asarray(color))[0],
        baseColorTexture=image,
        alphaMode="BLEND" if see_through else None,
    )
    visual = visuals.TextureVisuals(uv=uv, material=material)
    if vertex_colors is not None:
        visual.vertex_attributes["color"] = vertex_colors
    return visual
