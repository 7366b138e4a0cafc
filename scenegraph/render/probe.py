"""What OpenGL can do here, found out in a subprocess.

On a machine without OpenGL, VTK does not report an error: it segfaults the interpreter when a render window is created
or first rendered. So the first window of a process is always opened by a child process; only what worked there is
used here.

The answer is kept for the life of the process and handed on to child processes in an environment variable, and is
never written to disk: a probe costs about half a second, while a stored answer that outlives a removed driver would
bring the segfault back.

``python -m scenegraph.render.probe --json`` prints the report.
"""

from __future__ import annotations

import argparse
import ctypes
import dataclasses
import json
import os
import platform
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from typing import Any

from ..errors import GLError
from ..json_text import json_text

WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
REPORT_VARIABLE = "SCENEGRAPH_GL_REPORT"
_EGL, _OSMESA = "vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"
_TIMEOUT_S = 60
_MARK = "scenegraph-gl-report:"
_LIMITS = (
    "GL_MAX_TEXTURE_SIZE",
    "GL_MAX_RENDERBUFFER_SIZE",
    "GL_MAX_VIEWPORT_DIMS",
    "GL_MAX_SAMPLES",
    "GL_MAX_ARRAY_TEXTURE_LAYERS",
    "GL_MAX_SHADER_STORAGE_BLOCK_SIZE",
    "GL_MAX_SHADER_STORAGE_BUFFER_BINDINGS",
    "GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS",
)


@dataclass(frozen=True)
class GLReport:
    """What a child process found.

    Attributes
    ----------
    ok : bool
        Whether an offscreen window could be opened and rendered.
    window_class : str
        VTK's class of the window that worked.
    vendor, renderer, version : str
        As OpenGL reports them.
    version_code : int
        430 for OpenGL 4.3; 0 where moderngl cannot attach.
    limits : dict of str to int
        Implementation limits by their GL names; empty where moderngl cannot attach.
    moderngl : str
        Version of moderngl that attached to VTK's context, or why it did not.
    moderngl_ok : bool
    message : str
        One sentence for the user.
    debian_packages : tuple of str
        What is missing, if `ok` is false and the machine may be a Debian.
    tried : tuple of (str, str)
        Window classes in the order they were tried, and how each ended.
    """

    ok: bool
    window_class: str = ""
    vendor: str = ""
    renderer: str = ""
    version: str = ""
    version_code: int = 0
    limits: dict[str, int] = field(default_factory=dict)
    moderngl: str = ""
    moderngl_ok: bool = False
    message: str = ""
    debian_packages: tuple[str, ...] = ()
    tried: tuple[tuple[str, str], ...] = ()

    @property
    def is_software(self) -> bool:
        """Whether triangles are drawn by the CPU."""
        name = self.renderer.lower()
        return any(word in name for word in ("llvmpipe", "softpipe", "swrast", "software"))

    @property
    def apt_line(self) -> str:
        """The command that installs what is missing, or ''."""
        if not self.debian_packages:
            return ""
        return "apt-get install --no-install-recommends " + " ".join(self.debian_packages)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return dataclasses.asdict(self) | {"is_software": self.is_software, "apt_line": self.apt_line}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> GLReport:
        """The inverse of `to_dict`."""
        names = {f.name for f in dataclasses.fields(cls)}
        known = {k: v for k, v in values.items() if k in names}
        known["debian_packages"] = tuple(known.get("debian_packages", ()))
        known["tried"] = tuple((str(a), str(b)) for a, b in known.get("tried", ()))
        return cls(**known)


_reports: dict[str, GLReport] = {}


def probe() -> GLReport:
    """What OpenGL can do here; opens no window in this process.

    Sets the environment variable ``VTK_DEFAULT_OPENGL_WINDOW`` to the window class that worked, unless that is the
    platform's own.
    """
    key = _surroundings()
    if key not in _reports:
        report = _inherited(key)
        if report is None:
            report = _try_all()
        _adopt(report)
        key = _surroundings()
        _reports[key] = report
        if report.ok:
            os.environ[REPORT_VARIABLE] = json_text({"key": key, "report": report.to_dict()})
    return _reports[key]


def require_gl() -> GLReport:
    """The report, or an error that says what to install.

    Raises
    ------
    GLError
        No window can be opened here.
    """
    report = probe()
    if not report.ok:
        raise GLError(report.message)
    return report


def _surroundings() -> str:
    """The environment that decides which driver is loaded: a child with another one probes anew."""
    prefixes = ("VTK_", "LIBGL_", "MESA_", "GALLIUM_", "EGL_", "__EGL_", "__GLX_", "__NV_", "OSMESA_")
    names = {"DISPLAY", "WAYLAND_DISPLAY", "LD_LIBRARY_PATH", "LD_PRELOAD"}
    return "\n".join(f"{k}={v}" for k, v in sorted(os.environ.items()) if k in names or k.startswith(prefixes))


def _inherited(key: str) -> GLReport | None:
    try:
        stored = json.loads(os.environ.get(REPORT_VARIABLE, ""))
        return GLReport.from_dict(stored["report"]) if stored["key"] == key else None
    except (ValueError, KeyError, TypeError):
        return None


def _adopt(report: GLReport) -> None:
    if report.ok and report.window_class in (_EGL, _OSMESA):
        os.environ[WINDOW_VARIABLE] = report.window_class


def _candidates() -> list[str]:
    """Window classes to try; '' leaves the choice to VTK."""
    wished = os.environ.get(WINDOW_VARIABLE, "")
    if not _is_linux():
        return [wished]
    order = [wished] if wished else []
    if os.environ.get("DISPLAY"):
        order.append("")
    return order + [name for name in (_EGL, _OSMESA) if name != wished]


def _try_all() -> GLReport:
    tried: list[tuple[str, str]] = []
    for name in _candidates():
        found, ending = _try_one(name)
        tried.append((name or "platform default", ending))
        if found is not None:
            return dataclasses.replace(GLReport.from_dict(found), tried=tuple(tried))
    return _failure(tried)


def _try_one(window_class: str) -> tuple[dict[str, Any] | None, str]:
    env = dict(os.environ)
    env.pop(WINDOW_VARIABLE, None)
    if window_class:
        env[WINDOW_VARIABLE] = window_class
    command = [sys.executable, "-c", "from scenegraph.render.probe import report_here; report_here()"]
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    env["PYTHONPATH"] = os.pathsep.join([root, *filter(None, [env.get("PYTHONPATH")])])
    try:
        child = subprocess.run(command, env=env, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return None, f"gave no answer within {_TIMEOUT_S} s"
    except OSError as error:
        return None, f"could not be started: {error}"
    for line in child.stdout.splitlines():
        if line.startswith(_MARK):
            return json.loads(line[len(_MARK) :]), "works"
    if child.returncode < 0:
        return None, f"ended by {signal.Signals(-child.returncode).name}"
    last = child.stderr.strip().splitlines()[-1:] or ["no output"]
    return None, f"exit status {child.returncode}: {last[0][:200]}"


def _failure(tried: list[tuple[str, str]]) -> GLReport:
    packages: tuple[str, ...] = ()
    if _is_linux():
        # an installed EGL that failed lacks a driver; naming the installed package again would only confuse
        packages = ("libgl1-mesa-dri",) if _can_load("libEGL.so.1") else ("libegl1", "libgl1-mesa-dri")
    endings = "; ".join(f"{name}: {ending}" for name, ending in tried)
    report = GLReport(ok=False, debian_packages=packages, tried=tuple(tried))
    cure = f"on Debian or Ubuntu install it with: {report.apt_line}" if packages else "install a graphics driver"
    if packages:
        cure += " (or libosmesa6)"
    return dataclasses.replace(report, message=f"OpenGL does not work here ({endings}); {cure}")


def _is_linux() -> bool:
    return platform.system() == "Linux"


def _can_load(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def report_here() -> None:
    """Open a window in this process and print what it can do; meant for a child process that may crash."""
    if os.name == "posix":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the OpenGL implementations)
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

    window = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.SetSize(16, 16)
    window.AddRenderer(vtkRenderer())
    window.Render()
    lines = dict(line.split(":", 1) for line in window.ReportCapabilities().splitlines() if ":" in line)
    gl = {name: lines.get(f"OpenGL {name} string", "").strip() for name in ("vendor", "renderer", "version")}
    attached: dict[str, Any] = {}
    try:
        from importlib.metadata import version

        from .context import context_of

        gl_context = context_of(window)
        info = gl_context.info
        limits = {k: info[k] for k in _LIMITS if k in info}
        attached = {
            "moderngl": version("moderngl"),
            "moderngl_ok": True,
            "version_code": gl_context.version_code,
            "limits": {k: int(v if isinstance(v, int) else min(v)) for k, v in limits.items()},
        }
    except Exception as error:  # whatever keeps moderngl away is an answer, not a failure of the probe
        attached = {"moderngl": f"{type(error).__name__}: {error}"}
    kind = window.GetClassName()
    what = f"{gl['renderer']}, OpenGL {gl['version']}, through {kind}"
    found = {"ok": True, "window_class": kind, "message": what, **gl, **attached}
    sys.stdout.write(f"{_MARK}{json_text(found)}\n")
    sys.stdout.flush()
    # some drivers crash while they are unloaded; the answer is already out
    os._exit(0)


def main(argv: list[str] | None = None) -> int:
    """Print the report; exit status 2 if there is no OpenGL."""
    parser = argparse.ArgumentParser(prog="python -m scenegraph.render.probe", description="What OpenGL can do here.")
    parser.add_argument("--json", action="store_true", help="print the whole report as JSON")
    as_json = parser.parse_args(argv).json
    report = probe()
    sys.stdout.write((json_text(report.to_dict(), indent=2) if as_json else report.message) + "\n")
    return 0 if report.ok else 2


if __name__ == "__main__":
    sys.exit(main())
