"""JSON as browsers and jq read it: Python's own parser takes `Infinity` and `NaN`, which are not JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def parsed(text: str | Path) -> Any:
    """The value of a text, or of a file."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text.read_text(encoding="utf-8") if isinstance(text, Path) else text, parse_constant=refuse)
