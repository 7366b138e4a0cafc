"""What a benchmark found besides its time: printed below each, because the ratios are what counts."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def _print_findings(request: pytest.FixtureRequest) -> Iterator[None]:
    benchmark = request.getfixturevalue("benchmark") if "benchmark" in request.fixturenames else None
    yield
    if benchmark is not None and benchmark.extra_info:
        print(f"\n{request.node.name}")
        for what, value in benchmark.extra_info.items():
            print(f"    {what}: {value:,.4g}" if isinstance(value, float) else f"    {what}: {value}")
