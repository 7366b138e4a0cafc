"""An offscreen VTK window whose camera is a `View` and whose pictures come back as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .probe import require_gl

if TYPE_CHECKING:
    from ..view import View


class OffscreenWindow:
    """A `vtkRenderWindow` without a display.

    Parameters
    ----------
    width, height : int
        Size in pixels; `draw` follows the size of the view it is given.
    background : 3 floats in 0..1
    multisamples : int, default 0
        Samples per pixel. Pictures that are compared pixel by pixel need 0.
    vtk_culler : bool, default False
        Leave VTK's own `vtkFrustumCoverageCuller` in the renderer, as every VTK and pyvista program has it today.

    Attributes
    ----------
    renderer : vtkRenderer
    render_window : vtkRenderWindow

    Raises
    ------
    GLError
        There is no OpenGL here.
    """

    def __init__(
        self,
        width: int = 1280,
        height: int = 720,
        background: Sequence[float] = (0.72, 0.80, 0.88),
        *,
        multisamples: int = 0,
        vtk_culler: bool = False,
    ) -> None:
        self.report = require_gl()
        import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the OpenGL implementations)
        from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

        self.renderer: Any = vtkRenderer()
        self.renderer.SetBackground(*background)
        self.renderer.SetAutomaticLightCreation(False)
        self.renderer.AddLight(lamp())
        if not vtk_culler:
            self.renderer.GetCullers().RemoveAllItems()
        self.render_window: Any = vtkRenderWindow()
        self.render_window.SetOffScreenRendering(True)
        self.render_window.SetMultiSamples(multisamples)
        self.render_window.SetSize(int(width), int(height))
        self.render_window.AddRenderer(self.renderer)

    @property
    def width(self) -> int:
        """Pixels."""
        return int(self.render_window.GetSize()[0])

    @property
    def height(self) -> int:
        """Pixels."""
        return int(self.render_window.GetSize()[1])

    def draw(self, view: View) -> None:
        """Render from a view and wait until the picture is finished, so that a clock around this call tells the truth.

        The clipping range is the view's own and never follows what happens to be visible.
        """
        if (self.width, self.height) != (view.width, view.height):
            self.render_window.SetSize(view.width, view.height)
        view.to_vtk(self.renderer.GetActiveCamera())
        self.render_window.Render()
        self.render_window.WaitForCompletion()

    def image(self) -> NDArray[np.uint8]:
        """(h, w, 3) the last picture, top row first."""
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        width, height = self.width, self.height
        pixels = vtkUnsignedCharArray()
        self.render_window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        rows: NDArray[np.uint8] = _values(pixels).reshape(height, width, 3)
        return rows[::-1].copy()

    def depth(self) -> NDArray[np.float32]:
        """(h, w) depth of the last picture in window coordinates, 0 near to 1 far, top row first."""
        from vtkmodules.vtkCommonCore import vtkFloatArray

        width, height = self.width, self.height
        values = vtkFloatArray()
        self.render_window.GetZbufferData(0, 0, width - 1, height - 1, values)
        rows: NDArray[np.float32] = _values(values).reshape(height, width)
        return rows[::-1].copy()

    def close(self) -> None:
        """Give the OpenGL context back; the window cannot be used afterwards. Closing twice is allowed."""
        if self.render_window is not None:
            self.render_window.RemoveRenderer(self.renderer)
            self.render_window.Finalize()
            self.render_window = None
            self.renderer = None

    def __enter__(self) -> OffscreenWindow:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def lamp() -> Any:
    """A directional `vtkLight` from behind the viewer's left shoulder, which follows the camera.

    A headlight, VTK's default, leaves streets and walls black that are seen at a grazing angle, and gives walls that
    meet at a corner the same shade. One lamp costs 8 % of a frame more on a software renderer, and every further one
    10 to 20 % more.
    """
    from vtkmodules.vtkRenderingCore import vtkLight

    light = vtkLight()
    light.SetLightTypeToCameraLight()
    light.SetPositional(False)
    # in the coordinates of the camera, which is at (0, 0, 1) and looks at the origin
    light.SetPosition(-0.5, 0.8, 0.9)
    light.SetFocalPoint(0.0, 0.0, 0.0)
    return light


def _values(array: Any) -> Any:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    return convert(array)
