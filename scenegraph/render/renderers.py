"""What a driver asks a `vtkRenderer`: the view it is about to draw, and whether culling could change its picture."""

from __future__ import annotations

from typing import Any

from ..errors import SceneError
from ..view import View


def view_of(renderer: Any) -> View:
    """The view that a renderer is about to draw."""
    width, height = renderer.GetSize()
    # a screenshot larger than the window is put together from tiles, each drawn as a part of the whole
    across, down = renderer.GetRenderWindow().GetTileScale()
    if not width or not height:
        raise SceneError("the renderer has no size; show or render its window first")
    return View.from_vtk(renderer.GetActiveCamera(), width * across, height * down)


def is_part_in_tiles(renderer: Any) -> bool:
    """Whether a screenshot is put together from tiles, and the renderer fills only a part of the window."""
    tiles = tuple(renderer.GetRenderWindow().GetTileScale())
    return tiles != (1, 1) and tuple(renderer.GetViewport()) != (0.0, 0.0, 1.0, 1.0)


def unknown_projection(camera: Any) -> str:
    """What a `View` cannot express about a camera, or ''."""
    if camera.GetUseExplicitProjectionTransformMatrix():
        return "the camera has a projection matrix of its own"
    if camera.GetUseOffAxisProjection():
        return "the camera projects off-axis"
    if camera.GetUseHorizontalViewAngle():
        return "the camera's view angle is horizontal"
    if camera.GetUserViewTransform() is not None or camera.GetUserTransform() is not None:
        return "the camera has a transform of its own"
    if tuple(camera.GetViewShear()) != (0.0, 0.0, 1.0):
        return "the camera's view is sheared"
    return ""


def casts_shadows(renderer: Any) -> bool:
    """Whether a shadow map is among the renderer's passes."""
    waiting = [renderer.GetPass()]
    while waiting:
        render_pass = waiting.pop()
        if render_pass is None:
            continue
        if "Shadow" in render_pass.GetClassName():
            return True
        below = ("GetDelegatePass", "GetOpaqueSequence", "GetOpaquePass", "GetTranslucentPass")
        waiting.extend(getattr(render_pass, name)() for name in below if hasattr(render_pass, name))
        if hasattr(render_pass, "GetPasses") and render_pass.GetPasses() is not None:
            passes = render_pass.GetPasses()
            waiting += [passes.GetItemAsObject(i) for i in range(passes.GetNumberOfItems())]
    return False
