"""Fixtures of the tests of fitted occluders."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither read nor fill the user's cache."""
    monkeypatch.setenv("SCENEGRAPH_CACHE_DIR", str(tmp_path / "cache"))
