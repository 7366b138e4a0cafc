"""Pictures of a window, and cards in front of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .canvas import Card


def picture_of(renderer: Any) -> NDArray[np.uint8]:
    """(h, w, 3) what a renderer draws, without the layers in front of it and without showing it; top row first."""
    window = renderer.GetRenderWindow()
    renderers = window.GetRenderers()
    others = [renderers.GetItemAsObject(i) for i in range(renderers.GetNumberOfItems())]
    silent = [r for r in others if r.GetLayer() > renderer.GetLayer() and r.GetDraw()]
    swaps = window.GetSwapBuffers()
    window.SetSwapBuffers(False)
    for each in silent:
        each.SetDraw(False)
    try:
        window.Render()
        return pixels_of(window)
    finally:
        for each in silent:
            each.SetDraw(True)
        window.SetSwapBuffers(swaps)


def pixels_of(window: Any) -> NDArray[np.uint8]:
    """(h, w, 3) the last picture of a window, top row first."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    convert: Any = vtk_to_numpy
    width, height = window.GetSize()
    pixels = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
    rows: NDArray[np.uint8] = convert(pixels).reshape(height, width, 3)
    return rows[::-1].copy()


class CardActor:
    """A card at a place of a window, in a renderer of its own layer."""

    def __init__(self, renderer: Any) -> None:
        from vtkmodules.vtkCommonCore import vtkFloatArray, vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkRenderingCore import vtkPolyDataMapper2D, vtkTexture, vtkTexturedActor2D

        self._renderer = renderer
        self.card: Card | None = None
        self.x = self.y = 0
        self._points, cells, data = vtkPoints(), vtkCellArray(), vtkPolyData()
        self._points.SetNumberOfPoints(4)
        cells.InsertNextCell(4, (0, 1, 2, 3))
        corners = vtkFloatArray()
        corners.SetNumberOfComponents(2)
        for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
            corners.InsertNextTuple2(u, v)
        data.SetPoints(self._points)
        data.SetPolys(cells)
        data.GetPointData().SetTCoords(corners)
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(data)
        self._texture = vtkTexture()
        self._texture.InterpolateOff()
        self.actor: Any = vtkTexturedActor2D()
        self.actor.SetMapper(mapper)
        self.actor.SetTexture(self._texture)
        self.actor.SetPickable(False)
        self.actor.SetVisibility(False)
        renderer.AddViewProp(self.actor)

    def show(self, card: Card, left: int, top: int) -> None:
        """Draw a card with its upper left corner at this distance from the window's.

        Parameters
        ----------
        left, top : int
            Pixels; negative ones count from the right and the lower border.
        """
        from vtkmodules.util.numpy_support import numpy_to_vtk
        from vtkmodules.vtkCommonDataModel import vtkImageData

        width, height = self._renderer.GetRenderWindow().GetSize()
        h, w = card.image.shape[:2]
        self.x = left if left >= 0 else width - w + left
        self.y = top if top >= 0 else height - h + top
        if card is not self.card:
            convert: Any = numpy_to_vtk
            image = vtkImageData()
            image.SetDimensions(w, h, 1)
            image.GetPointData().SetScalars(convert(card.image[::-1].reshape(-1, 4), deep=True))
            self._texture.SetInputData(image)
            self.card = card
        low = height - self.y - h
        for index, (x, y) in enumerate(((0, 0), (w, 0), (w, h), (0, h))):
            self._points.SetPoint(index, self.x + x, low + y, 0)
        self._points.Modified()
        self.actor.SetVisibility(True)

    def hide(self) -> None:
        """Draw nothing."""
        self.card = None
        self.actor.SetVisibility(False)

    def at(self, x: float, y: float) -> tuple[Card, float, float] | None:
        """The card, and the place on it, under a point of the window given from its upper left corner."""
        if self.card is None:
            return None
        h, w = self.card.image.shape[:2]
        inside = self.x <= x < self.x + w and self.y <= y < self.y + h
        return (self.card, x - self.x, y - self.y) if inside else None
