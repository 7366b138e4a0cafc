"""OBJ text made fit for trimesh, whose reader is fast but trusting.

trimesh reads an object under its last material only, relative indices from the end of the file instead of from where
they stand, index 0 as 1, and stops at "1.#IND" and at faces beyond the vertices. So every run of faces with one object
and one material becomes an object of its own here, under a number, and faces are repaired where the text needs it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_DIRECTIVE = re.compile(r"^(o|g|usemtl|mtllib)(?: +(.*?))? *$", re.MULTILINE)
_INDENTED = re.compile(r"^ +", re.MULTILINE)
_NOT_A_NUMBER = re.compile(r"-?\d\.#(?:IND|QNAN|SNAN|INF)\w*|-?nan\(\w*\)", re.IGNORECASE)


@dataclass
class ObjText:
    """The repaired text and what its numbered objects stand for."""

    text: str
    #: Of each numbered object: which object of the file it is part of, and its material.
    runs: list[tuple[int, str | None]] = field(default_factory=list)
    #: Names of the objects of the file.
    objects: list[str] = field(default_factory=list)
    #: Files named by mtllib, in order.
    libraries: list[str] = field(default_factory=list)
    #: Faces dropped, by object of the file.
    dropped: dict[int, int] = field(default_factory=dict)


def read_obj_text(raw: bytes, name: str) -> ObjText:
    """Number the objects of an OBJ file.

    Objects are `o` records; a file without any is divided by its group names (`g`); a file with neither is one object
    called `name`.
    """
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ").replace("\t", " ") + "\n"
    if "\n " in text or text.startswith(" "):
        text = _INDENTED.sub("", text)
    if ".#" in text or "(" in text:
        text = _NOT_A_NUMBER.sub(lambda m: "inf" if "INF" in m[0].upper() else "nan", text)
    out = _number_runs(text, name)
    faces = [line for line in text.split("\n") if line.startswith("f ")]
    indices = " ".join(faces) + " "
    if " -" in indices or " 0/" in indices or " 0 " in indices or any(len(face.split()) < 4 for face in faces):
        repair_faces(out)
    return out


def _number_runs(text: str, name: str) -> ObjText:
    marks = list(_DIRECTIVE.finditer(text))
    by_object = any(m[1] == "o" for m in marks)
    out = ObjText("", objects=[name])
    numbers: dict[tuple[int, str | None], int] = {}
    groups: dict[str, int] = {}
    current, material, at = 0, None, 0
    pieces: list[str] = []
    for mark in [*marks, None]:
        body = text[at : mark.start() if mark else len(text)]
        if body.startswith("f ") or "\nf " in body:
            run = numbers.setdefault((current, material), len(numbers))
            # vertices of a run may stand before its faces: only the line right before the first face may be an `o`
            first = 0 if body.startswith("f ") else body.index("\nf ") + 1
            pieces += [body[:first], f"o {run}\n", body[first:]]
        else:
            pieces.append(body)
        if mark is None:
            break
        at = mark.end()
        value = mark[2] or ""
        if mark[1] == "mtllib":
            out.libraries.append(value)
        elif mark[1] == "usemtl":
            material = value or None
        elif mark[1] == "o":
            out.objects.append(value)
            current = len(out.objects) - 1
        elif not by_object:
            if value not in groups:
                groups[value] = len(out.objects)
                out.objects.append(value or name)
            current = groups[value]
    out.text = "".join(pieces)
    out.runs = list(numbers)
    return out


def repair_faces(obj: ObjText) -> None:
    """Make relative indices absolute, and drop and count faces that name vertices that do not exist."""
    total = {key: obj.text.count(f"\n{key} ") + obj.text.startswith(f"{key} ") for key in ("v", "vt", "vn")}
    so_far = dict.fromkeys(total, 0)
    run, lines = 0, []
    for line in obj.text.split("\n"):
        key, _, rest = line.partition(" ")
        if key in so_far:
            so_far[key] += 1
        elif key == "o":
            run = int(rest)
        elif key == "f":
            refs = [_absolute(ref, so_far, total) for ref in rest.split("#")[0].split()]
            if len(refs) < 3 or None in refs:
                part = obj.runs[run][0]
                obj.dropped[part] = obj.dropped.get(part, 0) + 1
                continue
            line = "f " + " ".join(ref for ref in refs if ref)
        lines.append(line)
    obj.text = "\n".join(lines)


def _absolute(ref: str, so_far: dict[str, int], total: dict[str, int]) -> str | None:
    out = []
    for key, index in zip(("v", "vt", "vn"), ref.split("/"), strict=False):
        if not index:
            out.append("")
            continue
        try:
            value = int(index)
        except ValueError:
            return None
        value += so_far[key] + 1 if value < 0 else 0
        if not 1 <= value <= total[key]:
            if key == "v":
                return None
            value = 1  # the face can be drawn, if not with the right texture or normal
        out.append(str(value))
    return "/".join(out)
