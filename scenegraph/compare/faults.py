"""What is wrong with a suite: every fault as a sentence, with its key and line."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from scenegraph.errors import PipelineError, nearest
from scenegraph.pipeline import Pipeline
from scenegraph.registry import Registry

Fault = tuple[str, str]
_HEADER = re.compile(r"^\s*(\[{1,2})\s*([^\[\]]+?)\s*\]{1,2}\s*(#.*)?$")
_ASSIGNMENT = re.compile(r"^\s*([\w.\-\"']+)\s*=")
_TYPES = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


def key_lines(text: str) -> dict[str, int]:
    """Find the line numbers, from 1, of the keys of a TOML text: `pipelines[1].stages`.

    Reads tables, arrays of tables and plain assignments. A key inside an inline table gets no line of its
    own; ask for the nearest one above with `line_of`.
    """
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = header[2].replace('"', "").replace(" ", "")
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = f"{table}[{counts[table]}]"
            else:
                first, _, rest = table.partition(".")
                table = f"{first}[{counts[first]}].{rest}" if first in counts and rest else table
            lines.setdefault(table, number)
        elif assignment := _ASSIGNMENT.match(line):
            key = assignment[1].replace('"', "").replace("'", "")
            lines.setdefault(f"{table}.{key}" if table else key, number)
    return lines


def line_of(key: str, lines: Mapping[str, int]) -> int | None:
    """Find the line of a key, or of the nearest table that encloses it."""
    while key:
        if key in lines:
            return lines[key]
        key = key[: max(key.rfind("."), key.rfind("["), 0)]
    return None


def listed(faults: list[Fault], lines: Mapping[str, int]) -> list[str]:
    """Write faults as sentences in the order of the file."""

    def place(fault: Fault) -> tuple[int, str]:
        return line_of(fault[0], lines) or 0, fault[0]

    sentences = []
    for key, message in sorted(dict.fromkeys(faults), key=place):
        line = line_of(key, lines)
        where = f"line {line}, " if line else ""
        sentences.append(f"{where}{key}: {message}" if key else f"{where}{message}")
    return sentences


def model_fault(error: Mapping[str, Any], fields: Mapping[str, frozenset[str]]) -> Fault:
    """Turn one pydantic error into key and sentence.

    Parameters
    ----------
    error : mapping
        An item of `ValidationError.errors()`.
    fields : mapping of str to set of str
        Known keys of each table, by the table's key without indices; the root is "".
    """
    key = ""
    for part in error["loc"]:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else str(part)
    given = error.get("input")
    match error["type"]:
        case "extra_forbidden":
            table, _, last = key.rpartition(".")
            known = fields.get(re.sub(r"\[\d+\]", "", table), frozenset())
            return key, f"there is no such key.{nearest(last, known)}"
        case "missing":
            return key, "is missing"
        case "value_error":
            return key, str(error["ctx"]["error"])
        case _:
            message = str(error["msg"])
            return key, f"is {given!r}; {message[0].lower()}{message[1:]}"


def scene_faults(data: Mapping[str, Any], registry: Registry, folder: Path | None) -> Iterator[Fault]:
    """Yield a scene that is not installed, options that it does not take, a file that is not there."""
    scene = data.get("scene")
    if not isinstance(scene, dict):
        return
    name, file = scene.get("name"), scene.get("file")
    if isinstance(file, str | Path) and not (path := (folder or Path()) / file).is_file():
        yield "scene.file", f"{path} " + ("is a folder; name a file in it" if path.is_dir() else "does not exist")
    if not isinstance(name, str):
        return
    if name not in registry.scenes:
        yield "scene.name", f"no scene {name!r} is installed.{nearest(name, registry.scenes)}"
        return
    quick = data.get("quick")
    for table, options in (
        ("scene.options", scene.get("options")),
        ("quick.options", quick.get("options") if isinstance(quick, dict) else None),
    ):
        if isinstance(options, dict):
            for option, message in option_faults(registry, name, options):
                yield f"{table}.{option}", message


def option_faults(registry: Registry, scene: str, options: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield options that a scene's function does not take, or not with this value."""
    known = registry.scenes[scene].options
    for option, value in options.items():
        if option not in known:
            yield option, f"the scene {scene!r} has no such option.{nearest(option, known)}"
            continue
        kind = type(known[option].default)
        fits = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
        if kind in _TYPES and not fits and not (kind is float and type(value) is int):
            yield option, f"is {value!r}; expected {_TYPES[kind]}"


def stage_faults(data: Mapping[str, Any], registry: Registry) -> Iterator[Fault]:
    """Yield pipelines whose text does not parse, or whose stages do not fit together."""
    pipelines = data.get("pipelines")
    for index, spec in enumerate(pipelines if isinstance(pipelines, list) else ()):
        text = spec.get("stages", "") if isinstance(spec, dict) else None
        if not isinstance(text, str):
            continue
        try:
            Pipeline.parse(text, registry)
        except PipelineError as error:
            for message in error.faults:
                yield f"pipelines[{index}].stages", message
