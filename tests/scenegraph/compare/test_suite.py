"""Suites: what a user may name, and every fault of a bad one, with key and line."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph import Geode, Group, Mesh, Registry, Scene, Stage, SuiteError, hookimpl, parameter
from scenegraph.compare.faults import key_lines, line_of
from scenegraph.compare.sources import thinned
from scenegraph.compare.suite import Suite, add_pipelines, builtin_suites, find_suite, parse_suite


class Keep(Stage):
    """Hides nothing, up to a bound."""

    name = "keep"
    pixels: float = parameter(1.0, minimum=0, maximum=10, help="ignored")

    def run(self, frame: object) -> None:
        """Do nothing."""


def boxes(*, count: int = 3, size: float = 1.0, colored: bool = False) -> Scene:
    """Boxes in a row."""
    mesh = Mesh.box((0, 0, 0), (size, size, size))
    return Scene(Group(*[Geode(mesh) for _ in range(count)]), name="boxes")


class Plugin:
    @hookimpl
    def scenegraph_register_stages(self, register: object) -> None:
        register(Keep)

    @hookimpl
    def scenegraph_register_scenes(self, register: object) -> None:
        register("boxes", boxes, "Boxes in a row.")


@pytest.fixture
def known() -> Registry:
    registry = Registry(discover=False)
    registry.add(Plugin(), name="tests")
    assert not registry.failures
    return registry


GOOD = """
summary = "a test"
frames = 5

[scene]
name = "boxes"
options.count = 4

[quick]
frames = 2
options = { count = 2 }

[[pipelines]]
name = "none"

[[pipelines]]
name = "kept"
stages = "keep(pixels=2)"
"""


def faults_of(text: str, known: Registry) -> tuple[str, ...]:
    with pytest.raises(SuiteError) as caught:
        parse_suite(text, known)
    assert all(fault in str(caught.value) for fault in caught.value.faults)
    return caught.value.faults


def test_a_good_suite(known: Registry) -> None:
    suite = parse_suite(GOOD, known, name="good")
    assert (suite.name, suite.frames, suite.scene.options) == ("good", 5, {"count": 4})
    assert [p.name for p in suite.pipelines] == ["none", "kept"]
    quick = suite.quicker()
    assert (quick.frames, quick.scene.options, quick.seconds) == (2, {"count": 2}, suite.quick.seconds)
    assert quick.pipelines == suite.pipelines


def test_every_fault_is_listed_with_line_and_key(known: Registry) -> None:
    bad = """
frames = 0
width = "wide"
speed = 9

[scene]
name = "boxs"
options = { count = 2 }

[[pipelines]]
name = "a"
stages = "kep | keep(pixels=99, pixel=1)"
drow = "actors"

[[pipelines]]
name = "a"
vtk_culler = true
"""
    faults = faults_of(bad, known)
    expected = [
        r"line 2, frames: is 0; input should be greater than or equal to 1",
        r"line 3, width: is 'wide'; input should be a valid integer.*",
        r"line 4, speed: there is no such key\..*",
        r"line 7, scene\.name: no scene 'boxs' is installed\. Did you mean 'boxes'\?",
        r"line 12, pipelines\[0\]\.stages: there is no stage 'kep'\. Did you mean 'keep'\?.*",
        r"line 12, pipelines\[0\]\.stages: stage 'keep': pixels=99 is above its maximum 10.*",
        r"line 12, pipelines\[0\]\.stages: stage 'keep' has no parameter 'pixel'\. Did you mean 'pixels'\?",
        r"line 13, pipelines\[0\]\.drow: there is no such key\. Did you mean 'draw'\?",
        r'line 15, pipelines\[1\]: vtk_culler = true needs draw = "actors".*',
    ]
    assert len(faults) == len(expected), faults
    for pattern in expected:
        assert any(re.fullmatch(pattern, fault) for fault in faults), (pattern, faults)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (("options.count = 4", "options.cuont = 4"), r"line 7, scene\.options\.cuont: .*Did you mean 'count'\?"),
        (("options.count = 4", "options.count = 4.5"), r"line 7, .*count: is 4\.5; expected a whole number"),
        (("options.count = 4", "options.count = true"), r"line 7, .*count: is True; expected a whole number"),
        (("options.count = 4", "options.colored = 1"), r"line 7, .*colored: is 1; expected true or false"),
        (("{ count = 2 }", "{ cuont = 2 }"), r"line 11, quick\.options\.cuont: .*"),
        (('name = "boxes"', 'file = "gone.glb"'), r"line 6, scene\.file: gone\.glb does not exist"),
        (('name = "boxes"', ""), r"line 5, scene: give either name .* or file .*"),
        (('name = "none"', 'name = "kept"'), r"two pipelines are called 'kept'; .*"),
        (('name = "none"', ""), r"line 13, pipelines\[0\]\.name: is missing"),
        (('name = "none"', "name = 3"), r"line 14, pipelines\[0\]\.name: is 3; input should be a valid string"),
        (("frames = 5", "supersample = 9"), r"line 3, supersample: is 9; .*less than or equal to 8"),
        (('"keep(pixels=2)"', '"keep("'), r"line 18, pipelines\[1\]\.stages: cannot read 'keep\('.*"),
    ],
)
def test_single_faults(change: tuple[str, str], fault: str, known: Registry) -> None:
    assert change[0] in GOOD
    faults = faults_of(GOOD.replace(*change), known)
    assert any(re.fullmatch(fault, f) for f in faults), faults


def test_no_pipelines_and_no_scene(known: Registry) -> None:
    assert set(faults_of("frames = 3", known)) == {"pipelines: is missing", "scene: is missing"}


def test_not_toml(known: Registry) -> None:
    (fault,) = faults_of("frames = = 3", known)
    assert "is not TOML" in fault
    assert "line 1" in fault


def test_what_an_argument_may_name(known: Registry, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(GOOD)
    assert find_suite(str(tmp_path / "own.toml"), known).name == "own"
    with pytest.raises(SuiteError, match=r"no suite, scene or file\. Did you mean 'boxes'\?"):
        find_suite("boxse", known)
    with pytest.raises(SuiteError, match=r"cannot read .*gone\.toml"):
        find_suite(str(tmp_path / "gone.toml"), known)
    with pytest.raises(SuiteError, match="copies a model file"):
        find_suite("boxes", known, scatter=3)


def test_a_scene_or_a_model_gets_the_usual_pipelines(tmp_path: Path) -> None:
    model = tmp_path / "cube.stl"
    model.write_text("solid")
    suite = find_suite(str(model), Registry(), scatter=10)
    assert (suite.name, suite.scene.file, suite.scene.scatter) == ("cube x 10", model, 10)
    assert [p.name for p in suite.pipelines] == ["none", "vtk-default", "frustum", "frustum+contribution"]
    assert suite.pipelines[1].vtk_culler


def test_files_are_found_beside_their_suite(known: Registry, tmp_path: Path) -> None:
    (tmp_path / "model.stl").write_text("solid")
    text = GOOD.replace('name = "boxes"\noptions.count = 4', 'file = "model.stl"').replace(
        "options = { count = 2 }", ""
    )
    (tmp_path / "suite.toml").write_text(text)
    assert find_suite(str(tmp_path / "suite.toml"), known).scene.file == tmp_path / "model.stl"


def test_pipelines_from_the_command_line(known: Registry) -> None:
    suite = add_pipelines(parse_suite(GOOD, known), ["keep(pixels=3)", "mine=keep | keep(pixels=4)"][:1], known)
    assert suite.pipelines[-1].name == suite.pipelines[-1].stages == "keep(pixels=3)"
    named = add_pipelines(suite, ["mine=keep(pixels=4)"], known).pipelines[-1]
    assert (named.name, named.stages) == ("mine", "keep(pixels=4)")
    with pytest.raises(SuiteError, match=r"pipelines\[3\]\.stages: there is no stage 'kep'"):
        add_pipelines(suite, ["kep"], known)


def test_built_in_suites_fit_what_is_installed() -> None:
    registry = Registry()
    for name in builtin_suites():
        suite = find_suite(name, registry)
        assert isinstance(suite, Suite)
        assert suite.pipelines[0].name == "none"
        assert suite.pipelines[0].stages == ""
        assert suite.summary


def test_lines_of_keys() -> None:
    lines = key_lines('a = 1\n[t]\n# b = 2\nb.c = 2\n[[u]]\nx = 1\n[[u]]\n"y" = [\n 1 ]\n[u.v]\nz = 1\n')
    assert lines == {
        "a": 1,
        "t": 2,
        "t.b.c": 4,
        "u[0]": 5,
        "u[0].x": 6,
        "u[1]": 7,
        "u[1].y": 8,
        "u[1].v": 10,
        "u[1].v.z": 11,
    }
    assert line_of("u[1].y[0]", lines) == 8
    assert line_of("u[1].gone", lines) == 7
    assert line_of("nowhere", lines) is None


@given(st.integers(1, 200), st.integers(1, 200))
def test_thinning_is_even(count: int, wanted: int) -> None:
    chosen = thinned(count, wanted)
    assert len(chosen) == min(count, wanted)
    assert chosen == sorted(set(chosen))
    assert set(chosen) <= set(range(count))
    if wanted > 1:
        assert (chosen[0], chosen[-1]) == (0, count - 1)
        gaps = [b - a for a, b in pairwise(chosen)]
        assert max(gaps, default=0) - min(gaps, default=0) <= 1
