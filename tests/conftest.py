"""What every test runs under: fixed seeds, one BLAS thread, a fixed hypothesis profile, and the gl and slow markers."""

from __future__ import annotations

import os

# Before numpy is imported for the first time: two threads on small products make timings jump.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import random
import zlib
from pathlib import Path

import hypothesis
import numpy as np
import pytest

# This folder is on the path: a package in it would be imported instead of the real one of the same name.
for package in Path(__file__).parent.rglob("__init__.py"):
    raise pytest.UsageError(f"remove {package}: tests are not packages")

from data_files import data_dir  # noqa: E402, F401 - a fixture
from scenegraph.render.probe import probe  # noqa: E402

CI = os.environ.get("CI", "").lower() in ("1", "true")

hypothesis.settings.register_profile("local", deadline=None, max_examples=50, print_blob=True)
hypothesis.settings.register_profile("ci", deadline=None, max_examples=50, derandomize=True, database=None)
hypothesis.settings.load_profile("ci" if CI else "local")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--run-slow", action="store_true", help="run the tests marked slow, too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.getoption("--run-slow"):
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="slow: runs with --run-slow"))


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("gl"):
        report = probe()
        if not report.ok:
            refuse = pytest.fail if CI else pytest.skip
            refuse(f"no OpenGL: {report.message}")


@pytest.fixture(autouse=True)
def _seeded() -> None:
    """Give every test the same random numbers, whichever tests ran before it."""
    random.seed(0)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Random numbers that depend on the test's name only."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))
