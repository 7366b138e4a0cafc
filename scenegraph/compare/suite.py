"""Suites: which scene, which camera paths, which pipelines. TOML, and checked whole before anything is drawn.

A suite is found by what a user types after `scenegraph compare`: the name of a built-in suite, a `.toml`
file, the name of a scene, or a model file. The last two get the default pipelines.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from scenegraph.errors import SuiteError, nearest
from scenegraph.registry import Registry

from .faults import Fault, key_lines, listed, model_fault, scene_faults, stage_faults

Count = Annotated[int, Field(ge=1)]
Pixels = Annotated[int, Field(ge=1, le=16384)]
Name = Annotated[str, Field(min_length=1, max_length=60)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PipelineSpec(_Table):
    """One row of the comparison."""

    name: Name
    stages: str = ""
    """The text form, `frustum | contribution(pixels=2)`; empty hides nothing."""
    draw: Literal["auto", "batches", "actors"] = "auto"
    vtk_culler: bool = False
    """Leave VTK's own culler in the renderer, as a window of pyvista has it. Needs `draw = "actors"`."""
    adaptive: bool = False
    """Skip stages for a while whose time exceeds what they save. What is skipped depends on the clock."""
    summary: str = ""

    @model_validator(mode="after")
    def _culler_needs_actors(self) -> PipelineSpec:
        if self.vtk_culler and self.draw != "actors":
            raise ValueError('vtk_culler = true needs draw = "actors": VTK culls whole actors only')
        return self


class SceneSpec(_Table):
    """Where the drawables come from: a built-in scene by `name`, or a model `file`."""

    name: str | None = None
    file: Path | None = None
    options: dict[str, Any] = Field(default_factory=dict)
    occluders: Literal["declared", "fitted"] = "declared"
    """`fitted` takes the scene's own occluders away; stages that need some get those fitted into the meshes."""
    scatter: Count | None = None
    """Draw this many copies of the file's model, spread at random in a cube."""

    @model_validator(mode="after")
    def _one_source(self) -> SceneSpec:
        if (self.name is None) == (self.file is None):
            raise ValueError("give either name (a built-in scene) or file (a model), not both or neither")
        if self.scatter is not None and self.file is None:
            raise ValueError("scatter copies a model file; for the built-in scene set options.count")
        if self.options and self.file is not None:
            raise ValueError("options belong to built-in scenes; a file has none")
        return self


class Quick(_Table):
    """What `--quick` changes."""

    paths: list[str] | None = None
    frames: Count = 12
    width: Pixels | None = None
    height: Pixels | None = None
    supersample: Annotated[int, Field(ge=1, le=8)] | None = None
    warmup: Annotated[int, Field(ge=0)] | None = None
    options: dict[str, Any] = Field(default_factory=dict)
    seconds: Annotated[float, Field(gt=0)] = 50.0
    """Frames are dropped, evenly along the path, where the first one shows that all would take longer."""


class Suite(_Table):
    """A comparison that can be repeated."""

    name: Name
    summary: str = ""
    scene: SceneSpec
    paths: list[str] = Field(default_factory=list)
    """Camera paths of the scene, "anywhere", or `.json` files with lists of views; empty takes all the scene has."""
    frames: Count = 48
    """Per path; a longer path is thinned evenly."""
    width: Pixels = 1280
    height: Pixels = 720
    supersample: Annotated[int, Field(ge=1, le=8)] = 1
    """The item buffer has this many times the frame's width and height."""
    warmup: Annotated[int, Field(ge=0)] = 2
    """Frames drawn before the clock counts."""
    seconds: Annotated[float, Field(gt=0)] | None = None
    pipelines: list[PipelineSpec] = Field(min_length=1)
    quick: Quick = Field(default_factory=Quick)

    @model_validator(mode="after")
    def _names_differ(self) -> Suite:
        names = [p.name for p in self.pipelines]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"two pipelines are called {twice[0]!r}; the report needs to tell them apart")
        return self

    def quicker(self) -> Suite:
        """Return the suite as `--quick` runs it."""
        q = self.quick
        changes: dict[str, Any] = {"frames": min(q.frames, self.frames), "seconds": q.seconds}
        for key in ("paths", "width", "height", "supersample", "warmup"):
            if getattr(q, key) is not None:
                changes[key] = getattr(q, key)
        if q.options:
            options = {**self.scene.options, **q.options}
            changes["scene"] = self.scene.model_copy(update={"options": options})
        return self.model_copy(update=changes)


_FIELDS = {
    "": frozenset(Suite.model_fields),
    "scene": frozenset(SceneSpec.model_fields),
    "pipelines": frozenset(PipelineSpec.model_fields),
    "quick": frozenset(Quick.model_fields),
}


def builtin_suites() -> dict[str, str]:
    """Return the text of the suites that come with the package, by name."""
    folder = resources.files(__package__) / "suites"
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name)
    return {f.name.removesuffix(".toml"): f.read_text(encoding="utf-8") for f in files}


def find_suite(argument: str, registry: Registry, *, scatter: int | None = None) -> Suite:
    """Find the suite that a command-line argument means.

    Parameters
    ----------
    argument : str
        A built-in suite, a `.toml` file, a scene, or a model file; tried in this order.
    registry : Registry
    scatter : int, optional
        Copies of the model file.

    Raises
    ------
    SuiteError
        Nothing of that name, or a suite with faults; all of them are listed.
    """
    builtin = builtin_suites()
    path = Path(argument)
    if scatter is not None and (argument in builtin or argument in registry.scenes or path.suffix == ".toml"):
        raise SuiteError(f"--scatter copies a model file, and {argument!r} is none")
    if argument in builtin:
        return parse_suite(builtin[argument], registry, name=argument)
    if path.suffix.lower() == ".toml":
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SuiteError(f"cannot read {argument}: {error}") from error
        return parse_suite(text, registry, name=path.stem, folder=path.parent)
    # the stages that need nothing prepared: a large file should not wait for more than was asked for
    defaults = tomllib.loads(builtin["scatter"])
    common = {key: defaults[key] for key in ("width", "height", "pipelines")}
    if argument in registry.scenes:
        return suite_of({"name": argument, "scene": {"name": argument}, **common}, registry)
    if path.exists():
        name = path.stem if scatter is None else f"{path.stem} x {scatter}"
        scene = {"file": path, "scatter": scatter}
        return suite_of({"name": name[:60], "scene": scene, **common}, registry)
    known = {*builtin, *registry.scenes}
    raise SuiteError(f"{argument!r} is no suite, scene or file.{nearest(argument, known)}")


def parse_suite(text: str, registry: Registry, *, name: str = "suite", folder: Path | None = None) -> Suite:
    """Read and check a suite.

    Parameters
    ----------
    text : str
        TOML.
    registry : Registry
        Supplies the stages and scenes that the suite may name.
    name : str
        Used where the suite does not name itself.
    folder : Path, optional
        What relative file names in the suite are relative to.

    Raises
    ------
    SuiteError
        `faults` holds one sentence per fault, each with its line and key.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SuiteError(f"{name} is not TOML: {error}") from error
    data.setdefault("name", name)
    return suite_of(data, registry, lines=key_lines(text), folder=folder)


def add_pipelines(suite: Suite, texts: list[str], registry: Registry) -> Suite:
    """Add pipelines given as `text` or `name=text` on the command line."""
    pipelines = list(suite.pipelines)
    for text in texts:
        named = re.match(r"([\w+.-]+)\s*=\s*(.*)", text, re.DOTALL)
        name, stages = named.groups() if named else (text, text)
        pipelines.append(PipelineSpec.model_construct(name=name[:60], stages=stages))
    data = suite.model_dump(exclude_none=True)
    return suite_of({**data, "pipelines": [p.model_dump() for p in pipelines]}, registry)


def suite_of(
    data: dict[str, Any],
    registry: Registry,
    *,
    lines: Mapping[str, int] | None = None,
    folder: Path | None = None,
) -> Suite:
    """Check a suite given as the table that a TOML file would hold.

    Parameters
    ----------
    data : dict
    registry : Registry
    lines : mapping of str to int, optional
        Where the keys stand in the file, for the messages (see `key_lines`).
    folder : Path, optional
        What relative file names are relative to.

    Raises
    ------
    SuiteError
        `faults` holds one sentence per fault.
    """
    faults: list[Fault] = []
    suite = None
    try:
        suite = Suite.model_validate(data)
    except ValidationError as error:
        faults += [model_fault(dict(fault), _FIELDS) for fault in error.errors()]
    faults += [*scene_faults(data, registry, folder), *stage_faults(data, registry)]
    if suite is None or faults:
        raise SuiteError(listed(faults, lines or {}))
    if folder is not None and suite.scene.file is not None:
        scene = suite.scene.model_copy(update={"file": folder / suite.scene.file})
        suite = suite.model_copy(update={"scene": scene})
    return suite
