"""Small-feature culling: what is only a few pixels large may be left out.

As OpenSceneGraph's small-feature culling and `vtkFrustumCoverageCuller.MinimumCoverage`, but by the size of the box's
own image, for orthographic views too, and never for boxes that reach the near plane.
"""

from __future__ import annotations

from scenegraph import Frame, Guarantee, Stage, parameter


class Contribution(Stage):
    """Hides what is smaller on the screen than a number of pixels."""

    name = "contribution"
    bound = "no hidden drawable's image is longer than `pixels` in any direction"

    pixels: float = parameter(
        0.0, minimum=0.0, maximum=10_000.0, unit="px", help="hide images smaller than this; 0 = off"
    )

    @property
    def guarantee(self) -> Guarantee:
        """Aggressive, unless it is off."""
        return Guarantee.AGGRESSIVE if self.pixels > 0 else Guarantee.CONSERVATIVE

    def skip(self, frame: Frame) -> str | None:
        """Off by default."""
        return None if self.pixels > 0 else "pixels = 0"

    def run(self, frame: Frame) -> None:
        """Project the boxes of what is still visible."""
        rows = frame.candidates()
        size = frame.view.box_pixels(frame.snapshot.boxes[:, rows])
        frame.count(tested=len(rows))
        frame.hide(rows[size < self.pixels])
