"""How long the commands that only answer take, in time of the processor, as another program may have it for a while."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import pytest


@pytest.mark.parametrize("command", ["stages", "scenes", "--help"])
def test_answering(benchmark: Any, command: str) -> None:
    """Beside the interpreter with NumPy alone."""

    def processor_seconds(*arguments: str) -> float:
        before = os.times()
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    ours = min(processor_seconds("-m", "scenegraph", command) for _ in range(5))
    numpy = min(processor_seconds("-c", "import numpy") for _ in range(5))
    sys.stdout.write(f"\nscenegraph {command}: {ours:.2f} s of the processor; importing NumPy alone {numpy:.2f} s\n")
    benchmark.extra_info["processor_seconds"] = ours
    benchmark.pedantic(processor_seconds, args=("-m", "scenegraph", command), rounds=3)
