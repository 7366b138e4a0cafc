"""The machine that a run was made on, as far as its numbers depend on it."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from scenegraph.threads import cores

if TYPE_CHECKING:
    from scenegraph.render.probe import GLReport

_VERSIONS = ("numpy", "vtk", "pyvista", "moderngl")


def describe_machine(gl: GLReport) -> dict[str, str]:
    """Describe processor, memory, system, Python and OpenGL, for people."""
    return {
        "processor": _processor(),
        "cores": str(cores()),
        "memory": f"{_memory_bytes() / 2**30:.0f} GiB",
        "system": f"{platform.system()} {platform.release()}",
        "Python": platform.python_version(),
        "packages": ", ".join(f"{name} {package_version(name) or 'missing'}" for name in _VERSIONS),
        "OpenGL": f"{gl.renderer}, {gl.version}",
        "drawn by": "the processor (software rendering)" if gl.is_software else "the graphics card",
        "window": gl.window_class,
    }


def package_version(name: str) -> str | None:
    """Look up the version of an installed distribution, or None."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def peak_memory() -> int:
    """Measure the largest resident size of this process so far in bytes; 0 where the system does not tell."""
    if sys.platform == "win32":
        return 0
    import resource

    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size if sys.platform == "darwin" else size * 1024


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            key, _, value = line.partition(":")
            if key.strip() in ("model name", "Model"):
                return value.strip()
    return platform.processor() or platform.machine()


def _memory_bytes() -> int:
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return 0
