"""The pictures of the viewer in the docs: a street, and the same street frozen and seen from outside.

Run it from the root of the project: ``python docs/images/viewer_pictures.py docs/images``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from scenegraph import Pipeline, View, registry
from scenegraph.viewer.window import ViewerWindow

#: Bytes of a picture in the docs.
LARGEST = 250_000


def main(folder: Path) -> None:
    """Write them into a folder."""
    known = registry()
    scene = known.scenes["city"].build()
    street = scene.paths["street"]
    size = (1280, 720)
    viewer = ViewerWindow(
        scene.snapshot(),
        [Pipeline.parse("frustum | shadow", known), Pipeline.parse("none", known)],
        known,
        path=street,
        size=size,
        off_screen=True,
    )
    session = viewer.session
    viewer.plotter.show(auto_close=False)
    for view in street[: len(street) // 3]:
        session.view = view.resized(*size)
        viewer.render()
    write(viewer, folder / "viewer-street.png")

    eye, ahead, up = np.array(session.view.eye), session.view.forward, np.array(scene.up)
    side = np.cross(ahead, up)
    outside = View(eye - 60 * ahead + 60 * up + 15 * side, eye + 60 * ahead, scene.up, fov=50)
    session.toggle_freeze()
    session.show_gizmos = session.show_hidden = True
    session.view = session.walker.fitted(outside.resized(*size))
    write(viewer, folder / "viewer-hidden.png")

    outside = View(eye - 260 * ahead + 190 * up + 60 * side, eye + 160 * ahead, scene.up, fov=50)
    session.view = session.walker.fitted(outside.resized(*size))
    session.show_hidden = False
    session.coloring = next(overlay for overlay in session.overlays if overlay.name == "by occluder")
    write(viewer, folder / "viewer-occluders.png")
    viewer.close()


def write(viewer: ViewerWindow, path: Path) -> None:
    """Save the window; where that makes a large file, in fewer colors."""
    picture = Image.fromarray(viewer.image())
    picture.save(path, optimize=True)
    if path.stat().st_size > LARGEST:
        picture.quantize(32, dither=Image.Dither.NONE).save(path, optimize=True)
    sys.stdout.write(f"wrote {path}, {path.stat().st_size / 1000:.0f} kB\n")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
