"""What each action of the key table does to a viewer window."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from .recording import Recorder

if TYPE_CHECKING:
    from .window import ViewerWindow

Action = Callable[["ViewerWindow", str], None]

_TURN = 4.0


def _flip(name: str, *, of_session: bool = False) -> Action:
    def act(viewer: ViewerWindow, _keysym: str) -> None:
        owner = viewer.session if of_session else viewer
        setattr(owner, name, not getattr(owner, name))

    return act


def _move(forward: float = 0.0, right: float = 0.0, up: float = 0.0) -> Action:
    def act(viewer: ViewerWindow, _keysym: str) -> None:
        session = viewer.session
        session.view = session.walker.step(session.view, forward, right, up)

    return act


def _turn(left: float) -> Action:
    def act(viewer: ViewerWindow, _keysym: str) -> None:
        session = viewer.session
        session.view = session.walker.turn(session.view, left)

    return act


def _pace(factor: float) -> Action:
    def act(viewer: ViewerWindow, _keysym: str) -> None:
        viewer.session.walker.pace *= factor
        viewer.say(f"one step is {viewer.session.walker.pace:.3g}")

    return act


def toggle_stage(viewer: ViewerWindow, keysym: str) -> None:
    """The digit says which."""
    viewer.session.toggle_stage(int(keysym) - 1)


def toggle_truth(viewer: ViewerWindow, _keysym: str) -> None:
    """Forget the last answer, too."""
    viewer.session.truth = not viewer.session.truth
    viewer.session.verdict = None


def next_coloring(viewer: ViewerWindow, _keysym: str) -> None:
    """And name it."""
    viewer.session.next_coloring()
    now = viewer.session.coloring
    viewer.say("the scene's own colors" if now is None else f"coloring: {now.name}")


def toggle_gizmos(viewer: ViewerWindow, _keysym: str) -> None:
    """Of the stages in the pipeline."""
    viewer.session.show_gizmos = not viewer.session.show_gizmos
    shown = [o.name for o in viewer.session.offered() if not o.is_coloring()]
    if viewer.session.show_gizmos:
        viewer.say(f"gizmos: {', '.join(shown)}" if shown else "no stage here brings gizmos")


def pick(viewer: ViewerWindow, _keysym: str) -> None:
    """What the pointer is on, and name it."""
    interactor = None if viewer.plotter.iren is None else viewer.plotter.iren.interactor
    width, height = viewer.window.GetSize()
    x, y = (width / 2, height / 2) if interactor is None else interactor.GetEventPosition()
    name = viewer.session.pick(x + 0.5, y + 0.5)
    viewer.say("nothing is picked" if name is None else f"picked {name}")


def toggle_walk(viewer: ViewerWindow, _keysym: str) -> None:
    """And say which it is now."""
    viewer.walking = not viewer.walking
    viewer.say("walking" if viewer.walking else "trackball")


def go_home(viewer: ViewerWindow, _keysym: str) -> None:
    """To the first view."""
    assert viewer.home is not None
    viewer.session.view = viewer.home.resized(*viewer.window.GetSize())


def toggle_replay(viewer: ViewerWindow, _keysym: str) -> None:
    """From where it was stopped."""
    viewer.replaying = bool(viewer.path) and not viewer.replaying
    if not viewer.path:
        viewer.say("there is no camera path; record one with r")


def toggle_recording(viewer: ViewerWindow, _keysym: str) -> None:
    """What was recorded becomes the path that is replayed, and a file."""
    if viewer.recorder is None:
        viewer.recorder = Recorder()
        viewer.say("recording")
        return
    views, viewer.recorder = viewer.recorder.views, None
    if not views:
        return
    path = viewer.record_to or _new_file("path", "json")
    recorder = Recorder()
    recorder.views = views
    recorder.write(path)
    viewer.saved.append(path)
    viewer.path, viewer.at, viewer.record_to = views, 0, None
    viewer.say(f"{len(views)} views written to {path}; space replays them")


def screenshot(viewer: ViewerWindow, _keysym: str) -> None:
    """Without the numbers: as a suite draws it."""
    path = _new_file("picture", "png")
    Image.fromarray(viewer.session.picture()).save(path)
    viewer.saved.append(path)
    viewer.say(f"saved {path}")


def quit_viewer(viewer: ViewerWindow, _keysym: str) -> None:
    """Leave the loop of the window; whoever runs it closes it."""
    if viewer.plotter.iren is not None and viewer.plotter.iren.interactor is not None:
        viewer.plotter.iren.interactor.TerminateApp()


def _new_file(kind: str, ending: str) -> Path:
    stem = f"scenegraph-{kind}-{time.strftime('%Y%m%d-%H%M%S')}"
    path, number = Path(f"{stem}.{ending}"), 2
    while path.exists():
        path, number = Path(f"{stem}-{number}.{ending}"), number + 1
    return path


#: By the names in the key table.
ACTIONS: dict[str, Action] = {
    "toggle_help": _flip("show_help"),
    "toggle_stage": toggle_stage,
    "other_pipeline": lambda viewer, _: viewer.session.other_pipeline(),
    "toggle_panel": _flip("show_panel"),
    "toggle_freeze": lambda viewer, _: viewer.session.toggle_freeze(),
    "next_coloring": next_coloring,
    "toggle_hidden": _flip("show_hidden", of_session=True),
    "toggle_boxes": _flip("show_boxes", of_session=True),
    "toggle_gizmos": toggle_gizmos,
    "toggle_truth": toggle_truth,
    "pick": pick,
    "toggle_walk": toggle_walk,
    "forward": _move(forward=1.0),
    "backward": _move(forward=-1.0),
    "left": _move(right=-1.0),
    "right": _move(right=1.0),
    "turn_left": _turn(_TURN),
    "turn_right": _turn(-_TURN),
    "rise": _move(up=1.0),
    "sink": _move(up=-1.0),
    "faster": _pace(1.5),
    "slower": _pace(1 / 1.5),
    "go_home": go_home,
    "toggle_replay": toggle_replay,
    "toggle_recording": toggle_recording,
    "screenshot": screenshot,
    "toggle_hud": _flip("show_hud"),
    "quit": quit_viewer,
}
