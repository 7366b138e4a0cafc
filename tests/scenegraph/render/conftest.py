"""An offscreen window for the tests of drawing."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from scenegraph.render.window import OffscreenWindow


@pytest.fixture
def window() -> Iterator[OffscreenWindow]:
    with OffscreenWindow(480, 270) as made:
        yield made
