"""Actors that belong to the user: which rows they are, and drawing other things than them for the time of a frame.

While a frame is drawn, the renderer's list of props holds what is visible, and batches instead of those actors that can
be drawn together (see `user_batches`); before and after, it holds what the user has put there, in the same order. The
actors themselves are not touched. With ten thousand of them every Python call per actor counts (0.5 µs, and
`vtkActor.GetRedrawMTime` 5 µs and more). So they are asked for edits as a whole, by the modification time of a
`vtkPropAssembly` that nobody draws, and their data report edits by themselves. An actor that is recolored leaves its
batch.
"""

from __future__ import annotations

import gc
from collections import deque
from collections.abc import Callable
from functools import wraps
from itertools import compress
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np

from ..scene import Scene
from .layout import I64
from .user_batches import UserBatches
from .user_levels import UserLevels

if TYPE_CHECKING:
    from ..frame import Frame

_P = ParamSpec("_P")


def _without_collecting(work: Callable[_P, None]) -> Callable[_P, None]:
    """Without looking for garbage meanwhile: of the many objects that are made, all stay, and each look sees them."""

    @wraps(work)
    def quiet(*args: _P.args, **kwargs: _P.kwargs) -> None:
        if not gc.isenabled():
            return work(*args, **kwargs)
        gc.disable()
        try:
            return work(*args, **kwargs)
        finally:
            gc.enable()

    return quiet


class UserActors:
    """The actors of a renderer as rows of a snapshot.

    Parameters
    ----------
    renderer : vtkRenderer
    batches : bool
        Draw actors that look alike together, see `user_batches`.

    Attributes
    ----------
    snapshot : Snapshot
    added : int
        Actors that came since: they are drawn always.

    Raises
    ------
    SceneError
        The renderer has nothing with triangles in it.
    """

    @_without_collecting
    def __init__(self, renderer: Any, batches: bool = False) -> None:
        from vtkmodules.vtkRenderingCore import vtkPropAssembly

        # asked for many times below, they would be wrapped for Python anew each time: 15 µs an actor
        held = [(p.GetMapper(), p.GetProperty()) for p in renderer.GetViewProps() if p.IsA("vtkActor")]
        self._renderer = renderer
        self._together = batches
        self.snapshot = Scene.from_pyvista(renderer).snapshot()
        numbers: dict[str, int] = {}
        self._actors: list[Any] = []
        self._actor_of_row = np.zeros(self.snapshot.n, np.int64)
        for row, node in enumerate(self.snapshot.geodes):
            actor: Any = getattr(node, "source")  # noqa: B009 - a Lod has none, and none is imported
            # VTK may hand out a new Python object for the same actor
            address = actor.GetAddressAsString("")
            if address not in numbers:
                numbers[address] = len(self._actors)
                self._actors.append(actor)
            self._actor_of_row[row] = numbers[address]
        self._props = renderer.GetViewProps()
        self._known_props = self._drawn_props = self._props.GetMTime()
        #: All that is in the renderer, in the order of drawing, and which actor that is, or -1.
        self._list: list[Any] = []
        self._actor_at: I64 = np.zeros(0, np.int64)
        self._numbers = numbers
        self._read_list()
        # parts of assemblies are rows, too, but not in the list of the renderer
        self._top = np.zeros(len(self._actors), bool)
        self._top[self._actor_at[self._actor_at >= 0]] = True
        self._count = len(self._list)
        self.added = 0
        self._replaced = False
        self._shown: list[Any] = []
        self._switched_off: list[Any] = []
        self._watched: Any = vtkPropAssembly()
        for actor in self._actors:
            self._watched.AddPart(actor)
        self._edited: set[int] = set()
        self._observed: list[tuple[Any, int]] = []
        self._live: dict[int, int] = {}
        for index, actor in enumerate(self._actors):
            self._listen(index, actor)
        self._states = [_state(a) for a in self._actors]
        visible = np.array([state[0] for state in self._states], bool)
        self._batches = UserBatches(self._actors, self._top & visible & self._together)
        once = np.bincount(self._actor_of_row, minlength=len(self._actors)) == 1
        own_row = np.full(len(self._actors), -1)
        own_row[self._actor_of_row] = np.arange(self.snapshot.n)
        opaque = np.zeros(len(self._actors), bool)
        opaque[self._actor_at[(self._actor_at >= 0) & self._in_order]] = True
        self._levels = UserLevels(self._actors, np.where(once & self._top & opaque, own_row, -1))
        self._mark = int(self._watched.GetMTime())
        del held

    def _read_list(self) -> None:
        props = self._props
        self._list = list(props)
        at = [self._numbers.get(prop.GetAddressAsString(""), -1) for prop in self._list]
        self._actor_at = np.array(at, np.int64)
        # what is translucent, or flat on the screen, is drawn after all that is opaque
        self._in_order = np.array([p.IsA("vtkActor") and p.GetProperty().GetOpacity() >= 1 for p in self._list], bool)

    def _listen(self, index: int, actor: Any) -> None:
        mapper = actor.GetMapper()
        data = mapper.GetInputDataObject(0, 0)

        def edited(*_: object) -> None:
            self._edited.add(index)

        points = data.GetPoints() if hasattr(data, "GetPoints") else None
        table = mapper.GetLookupTable() if mapper.GetScalarVisibility() else None
        for thing in (mapper, data, points, table):
            if thing is not None:
                self._observed.append((thing, thing.AddObserver("ModifiedEvent", edited)))
        source = mapper.GetInputAlgorithm()
        if (source is not None and not source.IsA("vtkTrivialProducer")) or data.IsA("vtkCompositeDataSet"):
            # what a filter makes, or a block holds, changes without telling those below
            self._live[index] = int(actor.GetRedrawMTime())

    def forget(self) -> None:
        """Stop listening. Forgetting twice is allowed."""
        for thing, observer in self._observed:
            thing.RemoveObserver(observer)
        self._observed.clear()
        self._watched = None
        for made in (self._batches, self._levels):
            made.release(self._renderer.GetRenderWindow())

    def change(self) -> str:
        """What the snapshot does not know about the actors, or ''.

        Actors that were added do not count: they are drawn, and hide nothing that was not hidden before.
        """
        if self._props.GetMTime() != self._known_props:
            self._read_list()
            here = np.zeros(len(self._actors), bool)
            here[self._actor_at[self._actor_at >= 0]] = True
            if (self._top & ~here).any():
                return "actors were removed"
            self._known_props = self._props.GetMTime()
            self.added = max(len(self._list) - self._count, 0)
        for index, time in self._live.items():
            if (now := int(self._actors[index].GetRedrawMTime())) != time:
                self._live[index] = now
                self._edited.add(index)
        if int(self._watched.GetMTime()) != self._mark:
            self._edited.update(i for i, a in enumerate(self._actors) if a.GetMTime() > self._mark)
        # times change for much that does not matter here; the state says
        for index in sorted(self._edited):
            if _state(self._actors[index]) != self._states[index]:
                return "an actor was moved, hidden or edited"
            if self._batches.has_changed(index):
                self._batches.leave(index)
            self._levels.leave(index)
        self._edited.clear()
        self._mark = int(self._watched.GetMTime())
        return ""

    def apply(self, frame: Frame) -> None:
        """Draw the actors of which a row is visible, at its level; not stand-ins, but what they stand for."""
        wanted = np.zeros(len(self._actors), bool)
        kept = frame.kept()
        wanted[self._actor_of_row[kept]] = True
        # parts of an assembly, which stays
        self._switched_off = [self._actors[i] for i in np.flatnonzero(~wanted & ~self._top).tolist()]
        for actor in self._switched_off:
            actor.VisibilityOff()
        # what is not known here is drawn always
        drawn = np.where(self._actor_at >= 0, wanted[self._actor_at], True)
        coarse, levels = self._levels.coarse(frame)
        if frame.standins or frame.level.any():
            # what is drawn here, where that is more than the stages have asked for
            level = np.zeros(self.snapshot.n, np.uint8)
            rows = self._levels.row[coarse]
            level[rows] = frame.level[rows]
            frame.record.triangles = frame.triangles_of(kept, level)
        places = np.flatnonzero(drawn & self._in_order)
        # a level is drawn on its own, and between the pieces of a batch as its actor would be
        order = np.where(np.isin(self._actor_at[places], coarse), -1, self._actor_at[places])
        runs = self._batches.runs(order, self._renderer) if self._together else []
        if not runs and not levels and drawn.all():
            return
        props = self._list
        if levels:
            # None at the end: NumPy must not look into the actors for numbers
            instead, own = np.array([*self._actors, None], object), np.array([*props, None], object)[:-1]
            instead[coarse] = levels
            props = np.where(self._actor_at >= 0, instead[self._actor_at], own).tolist()
        for first, end, _ in runs:
            drawn[places[first:end]] = False
        shown: list[Any] = []
        at = 0
        for first, _, actor in runs:
            place = int(places[first])
            shown += compress(props[at:place], drawn[at:place].tolist())
            shown.append(actor)
            at = place
        shown += compress(props[at:], drawn[at:].tolist())
        self._replaced = True
        # not by AddActor and RemoveActor: what is taken out would lose all that is loaded into the GPU
        self._fill(shown)
        self._shown, self._drawn_props = shown, self._props.GetMTime()

    def _fill(self, props: list[Any]) -> None:
        self._props.RemoveAllItems()
        deque(map(self._props.AddItem, props), maxlen=0)

    def restore(self) -> None:
        """Put everything back."""
        if self._switched_off:
            for actor in self._switched_off:
                actor.VisibilityOn()
            self._switched_off = []
            self._mark = int(self._watched.GetMTime())
        if not self._replaced:
            return
        self._replaced = False
        was = self._props.GetMTime()
        if was == self._drawn_props:
            self._fill(self._list)
            self._known_props = self._props.GetMTime()
            return
        # somebody added or removed something while the frame was drawn
        props = self._props
        now = list(props)
        gone, come = _without(self._shown, now), _without(now, self._shown)
        self._fill([*_without(self._list, gone), *come])


def _without(props: list[Any], others: list[Any]) -> list[Any]:
    known = {p.GetAddressAsString("") for p in others}
    return [p for p in props if p.GetAddressAsString("") not in known]


def _state(actor: Any) -> tuple[Any, ...]:
    """All that decides what an actor covers."""
    mapper = actor.GetMapper()
    data = mapper.GetInputDataObject(0, 0)
    matrix = actor.GetMatrix()
    style = actor.GetProperty()
    return (
        actor.GetVisibility(),
        matrix.GetData(),
        0 if data is None else data.GetMTime(),
        style.GetOpacity(),
        style.GetRepresentation(),
    )
