"""JSON as strict parsers read it: every file and every answer in JSON that the package gives is written here."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(value: Any, *, indent: int | None = None, sort_keys: bool = False) -> str:
    """Write a value as JSON (RFC 8259), which knows no number that is not finite.

    Infinite numbers become the strings "Infinity" and "-Infinity", which `float` and JavaScript's `Number` turn back
    into numbers; NaN, which says that there is no number, becomes null.

    Parameters
    ----------
    value : dict, list, tuple, str, int, float, bool or None
    indent, sort_keys
        As for `json.dumps`.

    Raises
    ------
    TypeError
        Something in it is none of these.
    """
    return json.dumps(_finite(value), indent=indent, sort_keys=sort_keys, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        return None if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, dict):
        return {_finite(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value
