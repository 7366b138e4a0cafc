"""The folder of real models beside the checkout, for tests marked `data`."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def require_data() -> Path:
    """The folder; without it the test is skipped, but fails in CI, where the folder lies beside the checkout."""
    if not DATA.is_dir():
        refuse = pytest.fail if os.environ.get("CI", "").lower() in ("1", "true") else pytest.skip
        refuse(f"the test data folder {DATA} is missing")
    return DATA


@pytest.fixture
def data_dir() -> Path:
    """Folder of real and hostile models."""
    return require_data()
