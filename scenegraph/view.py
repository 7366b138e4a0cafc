"""View: one camera (Performer: channel), with everything a stage asks of it in float64.

Eye space is OpenGL's: x right, y up, looking along -z. Pixels have y up, as VTK's do.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError
from .kernels.projection import box_screen_rectangles

Triple = tuple[float, float, float]


def _triple(value: ArrayLike, what: str) -> Triple:
    array = np.asarray(value, np.float64).ravel()
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(f"view: {what} is {value!r}, expected three finite numbers")
    x, y, z = array.tolist()
    return (x, y, z)


def _unit(vector: Triple) -> Triple:
    length = math.hypot(*vector)
    return vector[0] / length, vector[1] / length, vector[2] / length


def _minus(a: Triple, b: Triple) -> Triple:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@dataclass(frozen=True, init=False)
class View:
    """A camera and the image it draws.

    Parameters
    ----------
    eye, target : 3 floats
        World coordinates; they must differ.
    up : 3 floats
        Need not be perpendicular to the line of sight. If parallel to it, another axis is taken.
    fov : float
        Vertical field of view in degrees, 0 < fov < 180. Ignored by orthographic views.
    width, height : int
        Image size in pixels.
    near, far : float
        Distances of the clipping planes along the line of sight, 0 < near < far (orthographic: near < far).
    parallel_scale : float, optional
        Half the height of the image in world units: makes the view orthographic.
    shift : 2 floats
        Offset of the image center from the axis, in half image sizes (VTK's window center).

    Raises
    ------
    SceneError
        A value out of range.
    """

    eye: Triple
    target: Triple
    up: Triple = (0.0, 0.0, 1.0)
    fov: float = 60.0
    width: int = 1280
    height: int = 720
    near: float = 0.1
    far: float = 5000.0
    parallel_scale: float | None = None
    shift: tuple[float, float] = (0.0, 0.0)

    def __init__(
        self,
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 0.0, 1.0),
        *,
        fov: float = 60.0,
        width: int = 1280,
        height: int = 720,
        near: float = 0.1,
        far: float = 5000.0,
        parallel_scale: float | None = None,
        shift: Sequence[float] = (0.0, 0.0),
    ) -> None:
        values: dict[str, Any] = {
            "eye": _triple(eye, "eye"),
            "target": _triple(target, "target"),
            "up": _triple(up, "up"),
            "fov": float(fov),
            "width": int(width),
            "height": int(height),
            "near": float(near),
            "far": float(far),
            "parallel_scale": None if parallel_scale is None else float(parallel_scale),
            "shift": (float(shift[0]), float(shift[1])),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        if self.eye == self.target:
            raise SceneError(f"view: eye and target are the same point {self.eye}")
        if not any(self.up):
            raise SceneError("view: up is the zero vector")
        if self.width < 1 or self.height < 1:
            raise SceneError(f"view: an image of {self.width}x{self.height} pixels; both must be at least 1")
        if not (math.isfinite(self.near) and math.isfinite(self.far) and self.near < self.far):
            raise SceneError(f"view: near={self.near:g} and far={self.far:g}; expected near < far, both finite")
        if self.parallel_scale is not None:
            if not (math.isfinite(self.parallel_scale) and self.parallel_scale > 0):
                raise SceneError(f"view: parallel_scale={self.parallel_scale!r} must be positive")
        else:
            if not 0.0 < self.fov < 180.0:
                raise SceneError(f"view: fov={self.fov:g} degrees; expected 0 < fov < 180")
            if self.near <= 0:
                raise SceneError(f"view: near={self.near:g}; a perspective view needs near > 0")

    # -- frame of the camera --------------------------------------------------------------------------------------

    @property
    def is_parallel(self) -> bool:
        """Whether the view is orthographic."""
        return self.parallel_scale is not None

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.width / self.height

    @cached_property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3) rows right, up, back: unit vectors of eye space in world coordinates."""
        # plain numbers: NumPy takes ten times as long for three of them, and every frame has a new view
        back = _unit(_minus(self.eye, self.target))
        right = _cross(_unit(self.up), back)
        if math.hypot(*right) < 1e-9:
            least = min(range(3), key=lambda i: abs(back[i]))
            right = _cross((float(least == 0), float(least == 1), float(least == 2)), back)
        right = _unit(right)
        return np.array([right, _cross(back, right), back])

    @property
    def forward(self) -> NDArray[np.float64]:
        """(3,) unit vector along the line of sight."""
        return np.asarray(-self.axes[2])

    @cached_property
    def window(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top of the image: tangents (perspective) or world units (orthographic)."""
        half = self.parallel_scale if self.parallel_scale is not None else math.tan(math.radians(self.fov) / 2)
        sx, sy = self.shift
        wide = half * self.aspect
        return (sx - 1) * wide, (sx + 1) * wide, (sy - 1) * half, (sy + 1) * half

    def resized(self, width: int, height: int) -> View:
        """The same camera with another image size (the vertical field of view stays)."""
        return dataclasses.replace(self, width=width, height=height)

    def moved(self, *, eye: ArrayLike | None = None, target: ArrayLike | None = None) -> View:
        """The same camera from another place."""
        values: dict[str, Any] = {"eye": eye, "target": target}
        return dataclasses.replace(self, **{k: v for k, v in values.items() if v is not None})

    # -- matrices and planes --------------------------------------------------------------------------------------

    def relative_eye(self, origin: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
        """(3,) eye minus origin, in float64: the only subtraction of large coordinates."""
        return np.subtract(self.eye, np.asarray(origin, np.float64))

    def view_matrix(self, origin: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
        """(4, 4) from world coordinates relative to `origin` to eye space."""
        m = np.eye(4)
        m[:3, :3] = self.axes
        m[:3, 3] = -self.axes @ self.relative_eye(origin)
        return m

    def projection(self) -> NDArray[np.float64]:
        """(4, 4) from eye space to OpenGL clip space (z in [-w, w])."""
        left, right, bottom, top = self.window
        n, f = self.near, self.far
        m = np.zeros((4, 4))
        m[0, 0], m[1, 1] = 2 / (right - left), 2 / (top - bottom)
        if self.is_parallel:
            m[0, 3], m[1, 3] = -(right + left) / (right - left), -(top + bottom) / (top - bottom)
            m[2, 2], m[2, 3], m[3, 3] = -2 / (f - n), -(f + n) / (f - n), 1
        else:
            m[0, 2], m[1, 2] = (right + left) / (right - left), (top + bottom) / (top - bottom)
            m[2, 2], m[2, 3], m[3, 2] = -(f + n) / (f - n), -2 * f * n / (f - n), -1
        return m

    @cached_property
    def eye_planes(self) -> NDArray[np.float64]:
        """(6, 4) frustum planes in eye space: unit inward normal and offset; left, right, bottom, top, near, far.

        The four side planes of a perspective view pass through the eye: their offset is exactly 0.
        """
        left, right, bottom, top = self.window
        ends = [(0.0, 0.0, -1.0, -self.near), (0.0, 0.0, 1.0, self.far)]
        if self.is_parallel:
            return np.array([(1, 0, 0, -left), (-1, 0, 0, right), (0, 1, 0, -bottom), (0, -1, 0, top), *ends], float)
        # v_i x v_(i+1) of the border rays, built from the tangents: no subtraction of far points
        a, b, c, d = (1.0 / math.hypot(1.0, tangent) for tangent in (left, right, bottom, top))
        sides = [(a, 0, a * left, 0), (-b, 0, -b * right, 0), (0, c, c * bottom, 0), (0, -d, -d * top, 0)]
        return np.array([*sides, *ends], float)

    @cached_property
    def _planes_from_eye(self) -> NDArray[np.float64]:
        planes = self.eye_planes.copy()
        planes[:, :3] = planes[:, :3] @ self.axes
        return planes

    def planes(self, origin: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
        """(6, 4) frustum planes in world axes relative to `origin`: inside is n·x + d ≥ 0."""
        planes = self._planes_from_eye.copy()
        if origin is not self.eye:
            planes[:, 3] -= planes[:, :3] @ self.relative_eye(origin)
        return planes

    def corners(self, near: float | None = None, far: float | None = None) -> NDArray[np.float64]:
        """(8, 3) world corners of the frustum between two depths: the near four, then the far four."""
        left, right, bottom, top = self.window
        points = []
        for depth in (self.near if near is None else near, self.far if far is None else far):
            k = 1.0 if self.is_parallel else depth
            points += [(k * x, k * y, -depth) for x, y in ((left, bottom), (right, bottom), (right, top), (left, top))]
        return np.asarray(np.array(points) @ self.axes + np.asarray(self.eye))

    def bounds(self, origin: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest (3,) corner of the box around the frustum, in world axes relative to `origin`."""
        left, right, bottom, top = self.window
        near, far, parallel = self.near, self.far, self.is_parallel
        corners: list[tuple[float, float]] = []
        # plain numbers, as for the axes
        for x, y, back in zip(*self.axes.tolist(), strict=True):
            low = min(left * x, right * x) + min(bottom * y, top * y)
            high = max(left * x, right * x) + max(bottom * y, top * y)
            if parallel:
                corners.append((low - max(near * back, far * back), high - min(near * back, far * back)))
            else:
                low, high = low - back, high - back
                corners.append((min(near * low, far * low), max(near * high, far * high)))
        least, most = np.array(corners).T + self.relative_eye(origin)
        return least, most

    # -- sizes in pixels ------------------------------------------------------------------------------------------

    def box_rects(
        self, boxes: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Conservative screen rectangles of world boxes.

        Parameters
        ----------
        boxes : (6, k) float64
            Centers and half extents, components first.

        Returns
        -------
        rects : (4, k) float64
            x0, y0, x1, y1 in pixels, clipped to the viewport; the whole viewport where `crossing`.
        depth : (k,) float64
            Smallest distance along the line of sight.
        crossing : (k,) bool
            The box reaches the near plane, or is not finite: it must be treated as visible.
        """
        return box_screen_rectangles(
            boxes,
            axes=self.axes,
            eye=np.asarray(self.eye),
            window=self.window,
            size=(self.width, self.height),
            near=self.near,
            parallel=self.is_parallel,
        )

    def pixels_per_unit(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Pixels that one world unit across the line of sight covers at a depth; +∞ at and behind the eye."""
        _, _, bottom, top = self.window
        scale = self.height / (top - bottom)
        d = np.asarray(depth, np.float64)
        if self.is_parallel:
            return np.full(d.shape, scale)
        with np.errstate(divide="ignore"):
            return np.where(d > 0, scale / np.where(d > 0, d, 1.0), np.inf)

    def box_depth(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) smallest distance of world boxes along the line of sight, at least `near`; NaN boxes give `near`."""
        forward = self.forward
        center = forward @ (boxes[:3] - np.asarray(self.eye)[:, None])
        return np.asarray(np.fmax(center - np.abs(forward) @ boxes[3:], self.near))

    def error_pixels(self, error: ArrayLike, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) largest size in pixels that a model error (world units) can take on in each box."""
        return np.asarray(np.asarray(error, np.float64) * self.pixels_per_unit(self.box_depth(boxes)))

    def pixels_error(self, pixels: ArrayLike, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) model error (world units) that projects to at most `pixels` in each box: inverse of `error_pixels`."""
        return np.asarray(np.asarray(pixels, np.float64) / self.pixels_per_unit(self.box_depth(boxes)))

    def box_pixels(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) upper bound of the diameter in pixels of each box's image; +∞ where it reaches the near plane.

        The unclipped screen rectangle's diagonal, so sizes of boxes beyond the border count in full.
        """
        rects, _, crossing = box_screen_rectangles(
            boxes,
            axes=self.axes,
            eye=np.asarray(self.eye),
            window=self.window,
            size=(self.width, self.height),
            near=self.near,
            parallel=self.is_parallel,
            clip=False,
        )
        size = np.hypot(rects[2] - rects[0], rects[3] - rects[1])
        return np.where(crossing, np.inf, size)

    # -- exchange -------------------------------------------------------------------------------------------------

    @classmethod
    def from_vtk(cls, camera: Any, width: int, height: int) -> View:
        """From a `vtkCamera` (or `pyvista.Camera`) and the size of its viewport in pixels."""
        near, far = camera.GetClippingRange()
        return cls(
            eye=camera.GetPosition(),
            target=camera.GetFocalPoint(),
            up=camera.GetViewUp(),
            fov=camera.GetViewAngle(),
            width=width,
            height=height,
            near=near,
            far=far,
            parallel_scale=camera.GetParallelScale() if camera.GetParallelProjection() else None,
            shift=camera.GetWindowCenter(),
        )

    from_pyvista = from_vtk

    def to_vtk(self, camera: Any) -> None:
        """Set a `vtkCamera` (or `pyvista.Camera`) to this view, clipping range included."""
        camera.SetPosition(*self.eye)
        camera.SetFocalPoint(*self.target)
        camera.SetViewUp(*self.axes[1])
        camera.SetViewAngle(self.fov)
        camera.SetParallelProjection(self.is_parallel)
        if self.parallel_scale is not None:
            camera.SetParallelScale(self.parallel_scale)
        camera.SetWindowCenter(*self.shift)
        camera.SetClippingRange(self.near, self.far)

    def to_pyvista(self) -> Any:
        """A `pyvista.Camera` of this view."""
        from importlib import import_module

        camera = import_module("pyvista").Camera()
        self.to_vtk(camera)
        return camera

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> View:
        """The inverse of `to_dict`.

        Raises
        ------
        SceneError
            Unknown or missing keys.
        """
        known = {f.name for f in dataclasses.fields(cls)}
        unknown = sorted(set(values) - known)
        missing = sorted({"eye", "target"} - set(values))
        if unknown or missing:
            raise SceneError(f"view: unknown keys {unknown}, missing keys {missing}")
        return cls(**values)
