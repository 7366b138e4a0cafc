"""Cameras of a file as views, and a trimesh camera as a view and back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..view import View
from .problems import Problems

#: Height of the image of a camera whose file names no resolution.
HEIGHT = 720


@dataclass(frozen=True)
class FileCamera:
    """A camera as glTF has it: looks along -z of its node, y is up.

    Parameters
    ----------
    name : str
    world : (4, 4) float
        Matrix of its node; scale is ignored.
    perspective : mapping with yfov (radians), znear, and perhaps aspectRatio, zfar
    orthographic : mapping with ymag (half height), xmag, znear, zfar
    """

    name: str
    world: NDArray[np.float64]
    perspective: Mapping[str, Any] | None = None
    orthographic: Mapping[str, Any] | None = None

    def view(self, bounds: NDArray[np.float64]) -> View:
        """The view; its target is the point of the line of sight that is nearest to the center of `bounds`.

        Raises
        ------
        SceneError
            A matrix or a value that no camera can have.
        """
        eye = self.world[:3, 3]
        with np.errstate(all="ignore"):
            axes = self.world[:3, :3] / np.linalg.norm(self.world[:3, :3], axis=0)
        if not np.isfinite(axes).all():
            raise SceneError("its node has a singular transform")
        center, size = (bounds[0] + bounds[1]) / 2, float(np.linalg.norm(bounds[1] - bounds[0]))
        ahead = float(-axes[:, 2] @ (center - eye))
        if not (math.isfinite(ahead) and ahead > 1e-6 * size):
            ahead = size if math.isfinite(size) and size > 0 else 1.0
        beyond = float(np.linalg.norm(center - eye)) + size
        values = self.orthographic or self.perspective or {}
        near = float(values.get("znear", 0.0 if self.orthographic else beyond * 1e-4))
        far = float(values.get("zfar", 0.0))
        if not far > near:  # glTF: no far plane means infinitely far
            far = near + 2 * beyond if math.isfinite(beyond) and beyond > 0 else near + 5000.0
        common: dict[str, Any] = {"eye": eye, "target": eye - axes[:, 2] * ahead, "up": axes[:, 1], "height": HEIGHT}
        if self.orthographic:
            half = abs(float(values.get("ymag", 1.0)))
            aspect = abs(float(values.get("xmag", half))) / half if half > 0 else 1.0
            return View(width=_width(aspect), near=near, far=far, parallel_scale=half, **common)
        aspect = float(values.get("aspectRatio", 16 / 9))
        fov = math.degrees(float(values.get("yfov", 1.0)))
        return View(width=_width(aspect), near=near, far=far, fov=fov, **common)


def _width(aspect: float) -> int:
    return min(max(round(HEIGHT * aspect), 1), 16 * HEIGHT) if math.isfinite(aspect) else HEIGHT


def as_views(cameras: Iterable[FileCamera], bounds: NDArray[np.float64], problems: Problems) -> dict[str, View]:
    """Views by unique name; cameras that cannot be used are written down."""
    views: dict[str, View] = {}
    for camera in cameras:
        name, number = camera.name, 1
        while name in views:
            number += 1
            name = f"{camera.name} {number}"
        try:
            views[name] = camera.view(bounds)
        except (SceneError, ValueError, TypeError) as error:
            problems.note("cameras that cannot be used, left out", name, str(error))
    return views


def from_trimesh_camera(scene: Any, world: NDArray[np.float64]) -> FileCamera:
    """The camera of a `trimesh.Scene`, whose node has the matrix `world`."""
    camera = scene.camera
    width, height = (float(x) for x in camera.resolution)
    return FileCamera(
        str(camera.name),
        world,
        {
            "yfov": math.radians(float(camera.fov[1])),
            "aspectRatio": width / height,
            "znear": float(camera.z_near),
            "zfar": float(camera.z_far),
        },
    )


def to_trimesh_camera(view: View, name: str) -> tuple[Any, NDArray[np.float64]]:
    """A trimesh camera and its (4, 4) camera-to-world matrix."""
    import trimesh

    make: Any = trimesh.scene.cameras.Camera  # without type information

    half = math.tan(math.radians(view.fov) / 2)
    horizontal = 2 * math.degrees(math.atan(half * view.aspect))
    camera = make(
        name=name,
        resolution=(view.width, view.height),
        fov=(horizontal, view.fov),
        z_near=view.near,
        z_far=view.far,
    )
    matrix = np.eye(4)
    matrix[:3, :3] = view.axes.T
    matrix[:3, 3] = view.eye
    return camera, matrix
