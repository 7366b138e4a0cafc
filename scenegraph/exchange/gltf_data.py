"""What is inside a glTF container: the JSON tree, its buffers, and the accessors that trimesh cannot read."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from . import problems as kinds
from .files import Beside
from .problems import Problems

Tree = dict[str, Any]

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def read_container(path: Path) -> tuple[Tree, bytes | None]:
    """JSON tree and binary chunk of a .glb or .gltf file; the content decides which of the two it is.

    Raises
    ------
    SceneError
        Cut short, not JSON, or another version than 2.
    """
    raw = path.read_bytes()
    if raw[:4] != b"glTF":
        return _parsed(path, raw), None
    if len(raw) < 20:
        raise SceneError(f"{path} is cut short: {len(raw)} bytes are no GLB file; copy or export it again")
    version, length = struct.unpack("<II", raw[4:12])
    if version != 2:
        raise SceneError(f"{path} is binary glTF version {version}; convert it to version 2")
    if length > len(raw):
        raise SceneError(
            f"{path} is cut short: it announces {length} bytes and has {len(raw)}; copy or export it again"
        )
    tree: Tree | None = None
    binary: bytes | None = None
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack("<II", raw[at : at + 8])
        if at + 8 + size > length:
            raise SceneError(
                f"{path} is cut short: a chunk of {size} bytes starts at byte {at + 8} of {length}; "
                "copy or export it again"
            )
        chunk = raw[at + 8 : at + 8 + size]
        if kind == _JSON and tree is None:
            tree = _parsed(path, chunk)
        elif kind == _BIN and binary is None:
            binary = chunk
        at += 8 + size
    if tree is None:
        raise SceneError(f"{path} is a GLB file without a JSON chunk; export it again")
    return tree, binary


def _parsed(path: Path, raw: bytes) -> Tree:
    try:
        tree = json.loads(raw.decode("utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise SceneError(f"{path} is not valid glTF: {error}; export it again") from error
    if not isinstance(tree, dict):
        raise SceneError(f"{path} is not valid glTF: its JSON is not an object; export it again")
    version = str(tree.get("asset", {}).get("version", "2.0"))
    if not version.startswith("2"):
        raise SceneError(f"{path} is glTF version {version}; convert it to version 2")
    return tree


def read_buffers(path: Path, tree: Tree, binary: bytes | None) -> list[bytes]:
    """Bytes of every buffer.

    Raises
    ------
    SceneError
        A file that the buffers name is missing, or a buffer is shorter than what is read from it.
    """
    buffers = []
    beside = Beside(path)
    for index, entry in enumerate(tree.get("buffers", [])):
        uri = entry.get("uri")
        try:
            if uri is not None:
                buffers.append(_bytes_of(uri, beside))
            else:
                buffers.append(binary or b"" if index == 0 else b"")
        except (OSError, binascii.Error) as error:
            raise SceneError(
                f"{path} needs the file {uri[:80]!r}, which cannot be found in {path.parent}; "
                "copy it there, or export the model as one .glb file"
            ) from error
    for index, view in enumerate(tree.get("bufferViews", [])):
        end, buffer = view.get("byteOffset", 0) + view["byteLength"], view["buffer"]
        has = len(buffers[buffer]) if buffer < len(buffers) else 0
        if end > has:
            uri = tree["buffers"][buffer].get("uri", "its binary chunk") if buffer < len(buffers) else "no buffer"
            raise SceneError(
                f"{path}: buffer view {index} reads {end} bytes of {uri[:80]!r}, which has {has}; "
                "copy or export it again"
            )
    return buffers


def _bytes_of(uri: str, beside: Beside) -> bytes:
    head, comma, payload = uri.partition(",")
    if head.startswith("data:") and comma:
        return base64.b64decode(payload) if head.endswith(";base64") else payload.encode("latin-1")
    return beside.get(uri)


def read_images(path: Path, tree: Tree, problems: Problems) -> dict[str, bytes]:
    """Image files by the name under which the tree names them; missing ones are written down."""
    out: dict[str, bytes] = {}
    beside = Beside(path)
    for entry in tree.get("images", []):
        uri = entry.get("uri")
        if uri is None or uri in out:
            continue
        try:
            out[uri] = _bytes_of(uri, beside)
        except (OSError, binascii.Error):
            problems.note(kinds.NO_TEXTURE, uri[:80], "not found")
    return out


def accessor_fault(tree: Tree, index: int) -> str:
    """Why an accessor cannot be read, or an empty string."""
    accessor = tree["accessors"][index]
    view_index = accessor.get("bufferView")
    if view_index is None:
        return ""
    item = np.dtype(_TYPES[accessor["componentType"]]).itemsize * _WIDTHS[accessor["type"]]
    view = tree["bufferViews"][view_index]
    stride = view.get("byteStride", item)
    end = accessor.get("byteOffset", 0) + stride * (accessor["count"] - 1) + item
    if accessor["count"] and end > view["byteLength"]:
        return f"accessor {index} reads {end} bytes of a buffer view that has {view['byteLength']}"
    return ""


def decode(tree: Tree, buffers: list[bytes], index: int) -> NDArray[Any]:
    """(count, width) values of an accessor, with its sparse substitutions and in 0..1 or -1..1 if normalized."""
    accessor = tree["accessors"][index]
    dtype, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
    count = accessor["count"]
    if "bufferView" in accessor:
        values = _strided(tree, buffers, accessor, dtype, width, count).copy()
    else:
        values = np.zeros((count, width), dtype)
    if (sparse := accessor.get("sparse")) is not None:
        where = sparse["indices"]
        rows = _strided(tree, buffers, where, np.dtype(_TYPES[where["componentType"]]), 1, sparse["count"])
        values[rows[:, 0]] = _strided(tree, buffers, sparse["values"], dtype, width, sparse["count"])
    if accessor.get("normalized") and dtype.kind in "iu":
        return np.asarray(np.maximum(values / np.iinfo(dtype).max, -1.0), np.float32)
    return values


def _strided(
    tree: Tree, buffers: list[bytes], where: Tree, dtype: np.dtype[Any], width: int, count: int
) -> NDArray[Any]:
    view = tree["bufferViews"][where["bufferView"]]
    start = view.get("byteOffset", 0) + where.get("byteOffset", 0)
    stride = view.get("byteStride", dtype.itemsize * width)
    return np.ndarray((count, width), dtype, buffers[view["buffer"]], offset=start, strides=(stride, dtype.itemsize))


def plain_accessors(tree: Tree, buffers: list[bytes]) -> None:
    """Replace the accessors that trimesh reads wrongly (sparse, normalized, quantized) by plain float32 ones.

    `tree` and `buffers` are changed in place.
    """
    accessors = tree.get("accessors", [])
    wanted: set[int] = set()
    for mesh in tree.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            attributes = primitive.get("attributes", {})
            named = [attributes.get(key) for key in ("POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0")]
            wanted.update(i for i in [*named, primitive.get("indices")] if i is not None)
    for index in sorted(wanted):
        accessor = accessors[index]
        quantized = accessor["componentType"] != 5126 and accessor["type"] != "SCALAR"
        if not ("sparse" in accessor or (quantized and "bufferView" in accessor)):
            continue
        values = decode(tree, buffers, index)
        values = values.astype("<u4" if accessor["type"] == "SCALAR" else "<f4")
        data = values.tobytes()
        buffers.append(data)
        tree["buffers"].append({"byteLength": len(data)})
        tree["bufferViews"].append({"buffer": len(buffers) - 1, "byteLength": len(data)})
        accessors[index] = {
            "bufferView": len(tree["bufferViews"]) - 1,
            "componentType": 5125 if accessor["type"] == "SCALAR" else 5126,
            "type": accessor["type"],
            "count": accessor["count"],
        }
