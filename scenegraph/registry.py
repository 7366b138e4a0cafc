"""Registry: the stages, scenes, metrics and preparations that plugins hand in, and what went wrong with the rest."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

import pluggy

from . import hookspecs
from .errors import PipelineError, SceneError, nearest
from .overlay import Overlay
from .scene import Scene
from .stage import Guarantee, Stage

#: Entry-point group in which distributions name their plugin modules.
GROUP = "scenegraph"

F = TypeVar("F")


@dataclass(frozen=True)
class PluginFailure:
    """A plugin that could not be used, and why, in one sentence."""

    name: str
    message: str


@dataclass(frozen=True)
class Entry(Generic[F]):
    """A registered function: its name, what it is for, and the plugin it came from."""

    name: str
    build: F
    summary: str
    plugin: str

    @property
    def options(self) -> dict[str, inspect.Parameter]:
        """Keyword options of the function."""
        return dict(inspect.signature(self.build).parameters)  # type: ignore[arg-type]


class Registry:
    """What is installed.

    Parameters
    ----------
    discover : bool, default True
        Load the plugins that installed distributions name in the entry-point group "scenegraph". Without, only what
        `add` is given is known: tests see nothing but themselves.
    """

    def __init__(self, *, discover: bool = True) -> None:
        self.stages: dict[str, type[Stage]] = {}
        self.scenes: dict[str, Entry[Callable[..., Scene]]] = {}
        self.metrics: dict[str, Entry[Callable[..., Any]]] = {}
        self.preparations: dict[str, Entry[Callable[..., Any]]] = {}
        self.replications: dict[str, Entry[Callable[..., Any]]] = {}
        self.overlays: dict[str, type[Overlay]] = {}
        self.failures: list[PluginFailure] = []
        self._origin: dict[str, str] = {}
        self._manager = pluggy.PluginManager("scenegraph")
        self._manager.add_hookspecs(hookspecs)
        if discover:
            self._discover(entry_points(group=GROUP))

    def _discover(self, found: Iterable[EntryPoint]) -> None:
        for point in sorted(found, key=lambda p: (not p.value.startswith("scenegraph"), p.name)):
            try:
                module = point.load()
            except Exception as error:
                # anything at all may go wrong in a stranger's import; the host must live on
                reason = f"{type(error).__name__}: {error}"
                self.failures.append(PluginFailure(point.name, f"could not be imported ({reason})"))
                continue
            self.add(module, name=point.name)

    def add(self, plugin: object, *, name: str | None = None) -> None:
        """Register a plugin: a module or object with hook implementations. What is wrong with it goes to `failures`."""
        label = name or str(getattr(plugin, "__name__", type(plugin).__name__))
        try:
            self._manager.register(plugin, name=label)
            self._manager.check_pending()
        except (ValueError, pluggy.PluginValidationError) as error:
            self.failures.append(PluginFailure(label, f"has hooks the host does not know ({error})"))
            if self._manager.has_plugin(label):
                self._manager.unregister(name=label)
            return
        only = self._manager.subset_hook_caller
        others = [p for p in self._manager.get_plugins() if p is not plugin]
        for hook, register in (
            ("scenegraph_register_stages", self._stage_door(label)),
            ("scenegraph_register_scenes", self._door(label, "scene", self.scenes)),
            ("scenegraph_register_metrics", self._door(label, "metric", self.metrics)),
            ("scenegraph_register_preparations", self._door(label, "preparation", self.preparations)),
            ("scenegraph_register_overlays", self._overlay_door(label)),
            ("scenegraph_register_replications", self._door(label, "replication", self.replications)),
        ):
            try:
                only(hook, others)(register=register)
            except Exception as error:
                self.failures.append(PluginFailure(label, f"{hook} raised {type(error).__name__}: {error}"))

    def _claim(self, plugin: str, kind: str, name: str) -> bool:
        key = f"{kind} {name!r}"
        if key in self._origin:
            self.failures.append(
                PluginFailure(
                    plugin, f"names a {key}, but plugin {self._origin[key]!r} already has one; kept the first"
                )
            )
            return False
        self._origin[key] = plugin
        return True

    def _stage_door(self, plugin: str) -> Callable[[type[Stage]], None]:
        def register(stage: type[Stage]) -> None:
            fault = _stage_fault(stage)
            if fault:
                self.failures.append(PluginFailure(plugin, fault))
            elif self._claim(plugin, "stage", stage.name):
                self.stages[stage.name] = stage

        return register

    def _overlay_door(self, plugin: str) -> Callable[[type[Overlay]], None]:
        def register(overlay: type[Overlay]) -> None:
            if not _is_overlay(overlay):
                fault = f"registered {overlay!r}, which is not a subclass of scenegraph.Overlay with a name"
                self.failures.append(PluginFailure(plugin, fault))
            elif self._claim(plugin, "overlay", overlay.name):
                self.overlays[overlay.name] = overlay

        return register

    def _door(self, plugin: str, kind: str, table: dict[str, Entry[Any]]) -> Callable[..., None]:
        def register(name: str, build: Callable[..., Any], summary: str = "") -> None:
            if self._claim(plugin, kind, name):
                table[name] = Entry(name, build, summary or (build.__doc__ or "").strip().partition("\n")[0], plugin)

        return register

    def origin(self, kind: str, name: str) -> str:
        """The plugin that registered "stage", "scene", "metric" or "preparation" `name`."""
        return self._origin[f"{kind} {name!r}"]

    def stage(self, name: str) -> type[Stage]:
        """The stage class of this name.

        Raises
        ------
        PipelineError
            There is none; the message gives the nearest name and what failed to load.
        """
        if name not in self.stages:
            raise PipelineError(self.unknown_stage(name))
        return self.stages[name]

    def unknown_stage(self, name: str) -> str:
        """The sentence that says that there is no such stage."""
        failed = f" (plugins that failed to load: {', '.join(f.name for f in self.failures)})" if self.failures else ""
        return f"there is no stage {name!r}.{nearest(name, self.stages)}{failed}"

    def scene(self, name: str) -> Entry[Callable[..., Scene]]:
        """The scene of this name.

        Raises
        ------
        SceneError
            There is none.
        """
        if name not in self.scenes:
            raise SceneError(f"there is no scene {name!r}.{nearest(name, self.scenes)}")
        return self.scenes[name]


def _is_overlay(thing: object) -> bool:
    return isinstance(thing, type) and issubclass(thing, Overlay) and bool(thing.name)


def _stage_fault(stage: object) -> str | None:
    if not (isinstance(stage, type) and issubclass(stage, Stage)):
        return f"registered {stage!r}, which is not a subclass of scenegraph.Stage"
    label = stage.__name__
    if not stage.name.isidentifier():
        return f"stage class {label} has the name {stage.name!r}; use a lower-case identifier"
    if inspect.isabstract(stage):
        return f"stage class {label} does not define run(self, frame)"
    try:
        promise: object = stage().guarantee
    except Exception as error:
        # a stranger's declarations; whatever they raise is one sentence here
        return f"stage class {label} cannot be made with its default parameters ({type(error).__name__}: {error})"
    if not isinstance(promise, Guarantee):
        return f"stage class {label}: guarantee is {promise!r}, not a scenegraph.Guarantee"
    return None


_shared: Registry | None = None


def registry() -> Registry:
    """The registry of all installed plugins, made at the first call."""
    global _shared
    if _shared is None:
        _shared = Registry()
    return _shared
