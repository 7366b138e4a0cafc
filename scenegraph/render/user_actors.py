"""Actors that belong to the user: which rows they are, and switching them off for the time of a frame.

With ten thousand actors every Python call per actor counts (0.5 µs, and `vtkActor.GetRedrawMTime` 5 µs and more). So
the actors are asked as a whole, by the modification time of a `vtkPropAssembly` that nobody draws; their data report
edits by themselves; and only actors that were switched off in a frame are switched on after it.
"""

from __future__ import annotations

from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from ..scene import Scene

if TYPE_CHECKING:
    from ..frame import Frame


class UserActors:
    """The actors of a renderer as rows of a snapshot.

    Parameters
    ----------
    renderer : vtkRenderer

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

    def __init__(self, renderer: Any) -> None:
        from vtkmodules.vtkRenderingCore import vtkPropAssembly

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
        # pyvista's actors look up every attribute in Python; bound methods are looked up once
        self._off = [a.VisibilityOff for a in self._actors]
        self._on = [a.VisibilityOn for a in self._actors]
        self._hidden = np.zeros(len(self._actors), bool)
        self._props = renderer.GetViewProps()
        self._known_props = self._props.GetMTime()
        here = self._here()
        self._count = len(here)
        # parts of assemblies are rows, too, but not in the list of the renderer
        self._expected = here & set(numbers)
        self.added = 0
        self._watched: Any = vtkPropAssembly()
        for actor in self._actors:
            self._watched.AddPart(actor)
        self._edited: set[int] = set()
        self._observed: list[tuple[Any, int]] = []
        self._live: dict[int, int] = {}
        for index, actor in enumerate(self._actors):
            self._listen(index, actor)
        self._states = [_state(a) for a in self._actors]
        self._mark = int(self._watched.GetMTime())

    def _listen(self, index: int, actor: Any) -> None:
        mapper = actor.GetMapper()
        data = mapper.GetInputDataObject(0, 0)

        def edited(*_: object) -> None:
            self._edited.add(index)

        points = data.GetPoints() if hasattr(data, "GetPoints") else None
        for thing in (mapper, data, points):
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

    def change(self) -> str:
        """What the snapshot does not know about the actors, or ''.

        Actors that were added do not count: they are drawn, and hide nothing that was not hidden before.
        """
        if self._props.GetMTime() != self._known_props:
            here = self._here()
            if not self._expected <= here:
                return "actors were removed"
            self._known_props = self._props.GetMTime()
            self.added = max(len(here) - self._count, 0)
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
        self._edited.clear()
        self._mark = int(self._watched.GetMTime())
        return ""

    def _here(self) -> set[str]:
        """Addresses of what is in the renderer."""
        props = self._props
        return {props.GetItemAsObject(i).GetAddressAsString("") for i in range(props.GetNumberOfItems())}

    def apply(self, frame: Frame) -> None:
        """Switch off the actors of which no row is visible; stand-ins are not drawn, but what they stand for is."""
        wanted = np.zeros(len(self._actors), bool)
        wanted[self._actor_of_row[frame.kept()]] = True
        self._hidden = ~wanted
        for switch_off in compress(self._off, self._hidden.tolist()):
            switch_off()

    def restore(self) -> None:
        """Switch them on again."""
        for switch_on in compress(self._on, self._hidden.tolist()):
            switch_on()
        self._hidden[:] = False
        self._mark = int(self._watched.GetMTime())


def _state(actor: Any) -> tuple[Any, ...]:
    """All that decides what an actor covers."""
    mapper = actor.GetMapper()
    data = mapper.GetInputDataObject(0, 0)
    matrix = actor.GetMatrix()
    style = actor.GetProperty()
    return (
        actor.GetVisibility(),
        tuple(matrix.GetElement(i, j) for i in range(3) for j in range(4)),
        0 if data is None else data.GetMTime(),
        style.GetOpacity(),
        style.GetRepresentation(),
    )
