"""Every key of the viewer, in one table: the window listens to it, `h` shows it, and the docs print it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Key:
    """One line of the list.

    Attributes
    ----------
    keys : tuple of str
        Names as X and VTK have them (keysyms).
    action : str
        Name of the method that is called.
    text : str
    label : str
        How the keys are written on screen; their names without.
    """

    keys: tuple[str, ...]
    action: str
    text: str
    label: str = ""

    @property
    def shown(self) -> str:
        """As written on screen and in the docs."""
        return self.label or " ".join(self.keys)


KEYS: tuple[Key, ...] = (
    Key(("h",), "toggle_help", "list of keys"),
    Key(tuple("123456789"), "toggle_stage", "switch a stage off and on", "1-9"),
    Key(("Tab",), "other_pipeline", "pipeline A or B", "Tab"),
    Key(("p",), "toggle_panel", "panel of parameters; drag the sliders"),
    Key(("f",), "toggle_freeze", "freeze the culling camera, and look from outside"),
    Key(("c",), "next_coloring", "next coloring: by hiding stage, by level, ..."),
    Key(("x",), "toggle_hidden", "hidden objects as red wire frame"),
    Key(("b",), "toggle_boxes", "bounding hierarchy"),
    Key(("g",), "toggle_gizmos", "gizmos of the stages: frusta, silhouettes, ..."),
    Key(("i",), "pick", "pick the object under the pointer; or none"),
    Key(("t",), "toggle_truth", "compare with the exact visible set"),
    Key(("m",), "toggle_walk", "walk, or turn the scene like a trackball"),
    Key(("w", "Up"), "forward", "forward", "w Up"),
    Key(("s", "Down"), "backward", "backward", "s Down"),
    Key(("a",), "left", "step left"),
    Key(("d",), "right", "step right"),
    Key(("Left",), "turn_left", "turn left", "Left"),
    Key(("Right",), "turn_right", "turn right", "Right"),
    Key(("e", "Prior"), "rise", "up", "e PgUp"),
    Key(("z", "Next"), "sink", "down", "z PgDn"),
    Key(("plus", "equal", "KP_Add"), "faster", "faster", "+"),
    Key(("minus", "KP_Subtract"), "slower", "slower", "-"),
    Key(("Home",), "go_home", "back to the first view", "Home"),
    Key(("space",), "toggle_replay", "replay the camera path", "space"),
    Key(("r",), "toggle_recording", "record a camera path"),
    Key(("k",), "screenshot", "save a picture of the scene"),
    Key(("u",), "toggle_hud", "numbers on screen"),
    Key(("q", "Escape"), "quit", "close the window", "q Esc"),
)


def by_keysym(table: Iterable[Key] = KEYS) -> dict[str, Key]:
    """The table by the names of the keys."""
    return {name: key for key in table for name in key.keys}


def docs_table(table: Iterable[Key] = KEYS) -> str:
    """The table in Markdown."""
    rows = "\n".join(f"| `{key.shown}` | {key.text} |" for key in table)
    return f"| key | does |\n|---|---|\n{rows}\n"
