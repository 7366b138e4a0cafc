"""The house keeps its promises: each rule that a machine can check has a gate here, and each gate names its rule."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest

import scenegraph
import scenegraph.kernels
from scenegraph import (
    Frame,
    Geode,
    Group,
    LevelOfVisibility,
    Lod,
    Mesh,
    Occluder,
    Pipeline,
    Registry,
    Scene,
    Stage,
    Transform,
    View,
    hookspecs,
)
from scenegraph.compare.suite import PipelineSpec, Quick, SceneSpec, Suite
from scenegraph.render.device import Device
from scenegraph.render.window import OffscreenWindow

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
REGISTRY = Registry()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
#: What installed plugins of other distributions add is theirs to document and test.
STAGES = {
    name: stage
    for name, stage in REGISTRY.stages.items()
    if (ROOT / "plugins" / stage.__module__.partition(".")[0]).is_dir()
}
#: What kernels work on: the first word of their names. A new word is a decision; make it here.
PREFIX = re.compile("angle|block|box|cone|edge|face|map|mesh|nearness|plane|point|rect|slice|span|sphere|window")


def sources(*folders: str) -> list[Path]:
    """Python files below folders of the checkout."""
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def relative(path: Path) -> str:
    """A short and stable name for a parametrized test."""
    return str(path.relative_to(ROOT))


def text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def imported(path: Path) -> Iterator[str]:
    """Absolute names of all modules that a file imports, wherever in it; relative ones keep their dots."""
    for node in ast.walk(ast.parse(text(path))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


ALL_SOURCES = sources("scenegraph", "plugins", "tests", "examples", "docs/_ext")
KERNEL_MODULES = [
    importlib.import_module(f"scenegraph.kernels.{found.name}")
    for found in pkgutil.iter_modules(scenegraph.kernels.__path__)
]


# Hooks


HOOKS = {name: value for name, value in vars(hookspecs).items() if name.startswith("scenegraph_")}


@pytest.mark.parametrize("name", HOOKS)
def test_every_hook_is_documented_with_its_exact_signature(name):
    signature = f"{name}({', '.join(inspect.signature(HOOKS[name]).parameters)})"
    assert f"## `{signature}`" in text(DOCS / "hooks.md")


def test_every_documented_hook_exists():
    assert set(re.findall(r"^## `(\w+)\(", text(DOCS / "hooks.md"), re.MULTILINE)) == set(HOOKS)


@pytest.mark.parametrize("name", HOOKS)
def test_every_hook_has_a_test(name):
    tests = [path for path in sources("tests") if path != Path(__file__)]
    assert any(re.search(rf"def {name}\(|hook\.{name}\b", text(path)) for path in tests)


# Stages and plugins


@pytest.mark.parametrize("name", STAGES)
def test_every_stage_has_a_page(name):
    page = text(DOCS / "stages" / f"{name}.md")
    assert page.startswith(f"# {name}\n")
    assert f"```{{stage}} {name}\n" in page
    assert f"\n{name}\n" in text(DOCS / "stages" / "index.md")


def test_every_stage_page_has_a_stage():
    assert {path.stem for path in (DOCS / "stages").glob("*.md")} - {"index"} == set(STAGES)


@pytest.mark.parametrize("name", STAGES)
def test_every_stage_passes_the_contract(name):
    """A test class that inherits StageContract names the stage, or its class."""
    tested = set()
    for path in sources("tests/plugins"):
        for node in ast.walk(ast.parse(text(path))):
            if isinstance(node, ast.ClassDef) and "StageContract" in map(ast.unparse, node.bases):
                tested |= {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}
                tested |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    assert {name, STAGES[name].__name__} & tested


@pytest.mark.parametrize("name", STAGES)
def test_every_number_has_a_bound(name):
    """Sliders, sweeps and validation are made from the bounds."""
    for p in STAGES[name].parameters().values():
        assert p.type not in (int, float) or p.minimum is not None or p.maximum is not None, p.name


def test_every_plugin_is_packaged_and_registered():
    folders = {path.parent.name for path in (ROOT / "plugins").glob("*/__init__.py")}
    packages = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    points = PROJECT["project"]["entry-points"]["scenegraph"]
    assert {p for p in packages if p.startswith("plugins/")} == {f"plugins/{name}" for name in folders}
    assert {value for value in points.values() if value.startswith("scenegraph_")} == folders
    contract = next(c for c in PROJECT["tool"]["importlinter"]["contracts"] if c["type"] == "independence")
    assert set(contract["modules"]) == folders


def test_everything_installed_loads():
    assert REGISTRY.failures == []


#: What plugins may import besides the names in `scenegraph.__all__`.
PUBLIC_ROOMS = {"kernels", "meshes", "progress", "render", "testing", "viewer"}
PUBLIC_MODULES = {"scenegraph.compare.metrics", "scenegraph.compare.replication"}


@pytest.mark.parametrize("path", sources("plugins"), ids=relative)
def test_plugins_use_public_names_only(path):
    """The door of a stranger: names in `scenegraph.__all__`, kernels, and what the docs call public."""
    for node in ast.walk(ast.parse(text(path))):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and (node.module or "").startswith("scenegraph"):
            public = node.module in ("scenegraph", *PUBLIC_MODULES) or node.module.split(".")[1] in PUBLIC_ROOMS
            assert public, node.module
            for alias in node.names:
                assert not alias.name.startswith("_"), alias.name
                assert node.module != "scenegraph" or alias.name in scenegraph.__all__, alias.name
        elif isinstance(node, ast.Import):
            assert not any(alias.name.startswith("scenegraph") for alias in node.names)


@pytest.mark.parametrize("path", sources("scenegraph"), ids=relative)
def test_host_knows_no_method_by_name(path):
    """No string in the host's code equals a stage's name; docstrings and suites may give examples."""
    constants = {n.value for n in ast.walk(ast.parse(text(path))) if isinstance(n, ast.Constant)}
    assert not constants & set(STAGES)
    assert not [name for name in imported(path) if name.startswith("scenegraph_")]


@pytest.mark.parametrize("exponent", [-30, 20])
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.gl] if "gl" in s.needs else []) for n, s in STAGES.items()]
)
def test_no_stage_depends_on_the_size_of_the_unit(name, exponent):
    """Scaling by a power of two is exact, so one row that changes betrays a constant in world units."""
    stage = STAGES[name]
    middle = {
        p.name: p.type((p.minimum + min(p.maximum, p.minimum + 20.0)) / 2)
        for p in stage.parameters().values()
        if p.type in (int, float) and p.minimum is not None and p.maximum is not None
    }
    changes = False
    for settings in ({}, middle):
        answers = [_drawn(stage(**settings), 2.0**e) for e in (0, exponent)]
        assert (answers[0] >= 0).any()
        assert np.array_equal(*answers)
        changes |= bool(answers[0].any())
    assert changes, "neither the defaults nor middling values hide or coarsen anything here: nothing was tried"


class PutsVisibility(Stage):
    """For stages that read what another one puts."""

    name = "puts_visibility"
    writes = (LevelOfVisibility,)

    def run(self, frame: Frame) -> None:
        """All there is, in turn."""
        frame.put(LevelOfVisibility.of(np.linspace(-1, 1, frame.snapshot.n)))


def _drawn(stage: Stage, scale: float) -> np.ndarray:
    """At which level a stage leaves boxes around the eye and behind an occluder; -1 if hidden, 99 if replaced."""
    rng = np.random.default_rng(7)
    levels = [Mesh.box(np.full(3, -half) * scale, np.full(3, half) * scale) for half in (0.5, 0.45)]
    low, high = np.array((6.0, 4.0, -4.0)) * scale, np.array((12.0, 10.0, 8.0)) * scale
    wall = Group(Geode(Mesh.box(low, high)), Occluder.box(low, high))
    errors = (0, 0.1 * scale)
    boxes = [Transform(Lod(*levels, errors=errors), translation=p * scale) for p in rng.uniform(-100, 100, (400, 3))]
    scene = Scene(Group(wall, *(Group(*boxes[i : i + 20]) for i in range(0, len(boxes), 20))))
    view = View((0, 0, 0), tuple(np.array((3, 2, 1)) * scale), near=0.5 * scale, far=90.0 * scale)
    before = [PutsVisibility()] if LevelOfVisibility in stage.reads else []
    with ExitStack() as stack:
        device = None
        if "gl" in stage.needs:
            window = stack.enter_context(OffscreenWindow(view.width, view.height))
            device = stack.enter_context(closing(Device(window)))
        pipeline = stack.enter_context(Pipeline([*before, stage]))
        snapshot = scene.snapshot()
        frame = pipeline.open(snapshot, device=device).run(view)
    answers = np.where(frame.visible, frame.level, np.int64(-1))
    answers[frame.kept() & ~frame.visible] = 99
    return answers[np.argsort(snapshot.keys)]


# Kernels


@pytest.mark.parametrize("path", sources("scenegraph/kernels"), ids=relative)
def test_kernels_import_numpy_and_nothing_else(path):
    """Other kernels and the words of annotations apart: no objects of the host, and no other library."""
    annotations = {"__future__", "collections.abc", "typing"}
    assert [n for n in imported(path) if n not in annotations and not re.match(r"numpy\b|\.\w*$", n)] == []


KERNELS = {
    name: function
    for module in KERNEL_MODULES
    for name, function in inspect.getmembers(module, inspect.isfunction)
    if function.__module__ == module.__name__ and not name.startswith("_")
}


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_keep_their_signature_rule(name):
    """Named by what they work on; data positional-only, options keyword-only; annotated and documented."""
    function = KERNELS[name]
    assert PREFIX.fullmatch(name.partition("_")[0])
    signature = inspect.signature(function)
    kinds = {p.kind for p in signature.parameters.values()}
    assert kinds <= {inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.KEYWORD_ONLY}
    assert inspect.Parameter.POSITIONAL_ONLY in kinds
    assert signature.return_annotation is not inspect.Signature.empty
    shapes = re.findall(r"\((?:\w+|\.\.\.)(?:, *(?:\w+|\.\.\.))*,?\)", function.__doc__ or "")
    others = set(re.findall(r"`(\w+)`", function.__doc__ or "")) & set(KERNELS)
    assert shapes or others, "the docstring gives no shape, nor the kernel whose shapes they are"


def test_kernels_hold_no_state():
    """Constant arrays are named in capitals; anything else that could remember a call has no place."""
    for module in KERNEL_MODULES:
        for name, value in vars(module).items():
            if not name.startswith("__") and not (isinstance(value, np.ndarray) and name.isupper()):
                assert not isinstance(value, (dict, list, set, np.ndarray)), f"{module.__name__}.{name}"


# Public names


def test_all_is_complete_and_sorted():
    public = {
        name for name, value in vars(scenegraph).items() if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert sorted(public - {"annotations"}) == sorted(scenegraph.__all__)
    assert len(set(scenegraph.__all__)) == len(scenegraph.__all__)


@pytest.mark.parametrize("name", scenegraph.__all__)
def test_every_public_name_is_documented(name):
    thing = getattr(scenegraph, name)
    if inspect.isclass(thing) or inspect.isfunction(thing):
        assert (thing.__doc__ or "").strip()
        members = vars(thing).items() if inspect.isclass(thing) else ()
        silent = [
            m
            for m, value in members
            if not m.startswith("_")
            and (inspect.isfunction(value) or isinstance(value, (property, classmethod, staticmethod)))
            and not (inspect.getdoc(getattr(thing, m)) or "").strip()
        ]
        assert not silent


def test_docs_show_every_public_name():
    assert "```{public}\n```" in text(DOCS / "api.md")
    assert "```{kernels}\n```" in text(DOCS / "api.md")


# Files


@pytest.mark.parametrize("path", sources("scenegraph", "plugins"), ids=relative)
def test_json_is_written_in_one_place(path):
    """`json.dump` writes what is not JSON; glTF is a user's own text, handed on to trimesh as it came."""
    if relative(path) not in ("scenegraph/json_text.py", "scenegraph/exchange/gltf.py"):
        assert not re.search(r"\bjson\.dumps?\b|\bfrom json\b", text(path))


# Imports


SLOW_IMPORTS = ("vtk", "vtkmodules", "pyvista", "matplotlib", "trimesh", "moderngl")
PROGRAMS = {
    "import": ("import scenegraph", (*SLOW_IMPORTS, "pydantic", "typer")),
    "registry": ("import scenegraph; scenegraph.Registry()", SLOW_IMPORTS),
    "stages": ("from scenegraph.cli import app; app(['stages'], standalone_mode=False)", SLOW_IMPORTS),
}


@pytest.mark.parametrize(("program", "forbidden"), PROGRAMS.values(), ids=PROGRAMS)
def test_slow_imports_are_left_to_the_rooms_that_need_them(program, forbidden):
    """`scenegraph stages` answers at once only if nothing on its way imports VTK and its like."""
    code = f"{program}\nimport sys\nprint('slow:', *sorted(set({forbidden!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "slow:"


# Files


@pytest.mark.parametrize("path", ALL_SOURCES, ids=relative)
def test_no_file_is_too_large(path):
    assert len(text(path).splitlines()) <= 500


@pytest.mark.parametrize("path", ALL_SOURCES, ids=relative)
def test_every_file_says_why_it_is_there(path):
    assert ast.get_docstring(ast.parse(text(path)))


# Examples and docs


EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.gl
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_runs(path, tmp_path):
    env = {**os.environ, "MPLBACKEND": "agg", "PYTHONWARNINGS": "error::DeprecationWarning:__main__"}
    env.pop("DISPLAY", None)
    program = [sys.executable, str(path)]
    done = subprocess.run(program, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip(), "an example prints what it found"
    assert not list(tmp_path.iterdir()), "an example leaves no files behind"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_in_the_gallery_and_mentioned(path):
    assert re.match(r'"""\n(?P<title>.+)\n=+\n\n\w', text(path)), "sphinx-gallery wants a title in the docstring"
    assert any(f"gallery/{path.stem}.rst" in text(page) for page in DOCS.rglob("*.md"))


@pytest.mark.parametrize("model", [Suite, SceneSpec, PipelineSpec, Quick], ids=lambda m: m.__name__)
def test_every_key_of_a_suite_is_documented(model):
    page = text(DOCS / "suites.md")
    assert not [key for key in model.model_fields if not re.search(rf"`\[*{key}\]*`", page)]


def test_every_page_is_reachable():
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md")}
    linked = {"index"}
    for page in DOCS.rglob("*.md"):
        folder = page.parent.relative_to(DOCS)
        for tree in re.findall(r"```{toctree}\n(.*?)```", text(page), re.DOTALL):
            linked |= {(folder / line).as_posix() for line in tree.split() if not line.startswith(":")}
    assert pages <= linked


def test_changelog_has_a_place_for_what_comes_next():
    headings = re.findall(r"^## (.+)$", text(ROOT / "CHANGELOG.md"), re.MULTILINE)
    assert headings
    assert headings[0] == "Unreleased"


# Commands


MAKEFILE = text(ROOT / "Makefile")
TARGETS = set(re.search(r"^\.PHONY: (.+)$", MAKEFILE, re.MULTILINE).group(1).split())  # type: ignore[union-attr]


def test_commands_in_the_prose_exist():
    """Every `make X` in README and docs is a target, and every `scenegraph X` a command."""
    command = [sys.executable, "-m", "scenegraph", "--help"]
    wide = {**os.environ, "COLUMNS": "200"}
    help_text = subprocess.run(command, capture_output=True, text=True, check=True, env=wide).stdout
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")]:
        commands = re.findall(r"(?:^\$ |`)((?:make|scenegraph) [a-z-]+)", text(page), re.MULTILINE)
        for command in commands:
            program, argument = command.split()
            if program == "make":
                assert argument in TARGETS, f"{relative(page)}: {command}"
            else:
                assert re.search(rf"\b{argument}\b", help_text), f"{relative(page)}: {command}"


def test_readme_and_ci_run_the_same_commands():
    readme = text(ROOT / "README.md")
    assert re.findall(r"^\$ (make .+)$", readme, re.MULTILINE) == ["make demo", "make test"]
    steps = re.search(r"^for step in (.+); do$", text(ROOT / ".ci" / "run"), re.MULTILINE).group(1).split()  # type: ignore[union-attr]
    assert set(steps) == {"lint", "docs", "test"}
    assert steps[-1] == "test", "pytest's closing line has to be among the last ones"


def test_every_target_is_explained():
    for target in TARGETS:
        assert re.search(rf"^#   make {target} +\w", MAKEFILE, re.MULTILINE), target
        assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), target


def test_version_is_stated_once_and_for_all():
    assert PROJECT["project"]["version"] == scenegraph.__version__
