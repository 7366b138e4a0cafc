"""Set-up for the Makefile: a virtual environment for the package, and system GL for what draws.

Standard library only, because it runs before anything is installed:

    python3 .ci/bootstrap.py venv [EXTRA ...]    make .venv and install the package with these extras
    python3 .ci/bootstrap.py gl                  check that OpenGL works; install it where that is allowed
    python3 .ci/bootstrap.py people              what tests drive the viewer with, as people would: a screen, a browser
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
PROBE = "from scenegraph.render.probe import main; main(['--json'])"


def main(arguments):
    """Run one sub-command and return its exit code."""
    command, *rest = arguments or ["help"]
    if command == "venv":
        return make_venv(rest)
    if command == "gl":
        return check_gl()
    if command == "people":
        return stand_in_for_people()
    print(__doc__)
    return 2


def make_venv(extras):
    """Make .venv if it is missing or unusable, then install this checkout, editable, with the extras."""
    if sys.version_info < (3, 11):
        return fail("Python 3.11 or newer is needed; this is %d.%d." % sys.version_info[:2])
    if not usable():
        if importlib.util.find_spec("ensurepip") is None:
            # Debian keeps `venv` in a package of its own.
            install_debian(["python%d.%d-venv" % sys.version_info[:2]], "Python's venv module")
        say("making the virtual environment .venv")
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(VENV)], check=True)
    target = ".[%s]" % ",".join(extras) if extras else "."
    say("installing %s into .venv (the first time, some hundred megabytes)" % target)
    pip = [str(PYTHON), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if subprocess.run([*pip, "--editable", target], cwd=ROOT).returncode:
        return fail("pip could not install %s; its message is above." % target)
    (VENV / ("installed-" + ("-".join(extras) or "core"))).touch()
    return 0


def usable():
    """Tell whether .venv holds a working interpreter with pip."""
    if not PYTHON.exists():
        return False
    return subprocess.run([str(PYTHON), "-m", "pip", "--version"], capture_output=True).returncode == 0


def check_gl():
    """Probe OpenGL in a subprocess; where it is missing, install it (root with apt) or say what to install."""
    report = probe_gl()
    if not report["ok"]:
        install_debian(report["debian_packages"] or ["libegl1", "libgl1-mesa-dri"], "OpenGL")
        report = probe_gl()
    if not report["ok"]:
        return fail("OpenGL still does not work: %s" % report["message"])
    say("OpenGL %s, %s (%s)" % (report["version"], report["renderer"], report["window_class"]))
    return 0


def stand_in_for_people():
    """Install a virtual screen and a browser where that is allowed; the tests that need them are skipped without."""
    tools = {"xvfb-run": "xvfb", "xauth": "xauth", "xdotool": "xdotool", "chromium": "chromium"}
    missing = sorted(package for tool, package in tools.items() if shutil.which(tool) is None)
    if missing and hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get"):
        install_debian(missing, "What drives a window or a page")
    elif missing:
        say("tests that drive the viewer are skipped; for them, install: %s" % " ".join(missing))
    return 0


def probe_gl():
    """Return the host's own GL report as a dictionary."""
    run = subprocess.run([str(PYTHON), "-c", PROBE], cwd=ROOT, capture_output=True, text=True)
    if run.returncode:
        sys.stderr.write(run.stderr)
        raise SystemExit(fail("the OpenGL probe itself failed; its message is above."))
    return json.loads(run.stdout)


def install_debian(packages, purpose):
    """Install Debian packages when running as root with apt; otherwise say which ones, and stop."""
    names = " ".join(packages)
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    if not root or shutil.which("apt-get") is None:
        raise SystemExit(
            fail(
                "%s is missing. On Debian or Ubuntu install it with:\n\n"
                "    sudo apt-get update && sudo apt-get install --no-install-recommends %s\n\n"
                "and run make again." % (purpose, names)
            )
        )
    say("%s is missing; running as root, so installing the Debian packages: %s" % (purpose, names))
    environment = dict(os.environ, DEBIAN_FRONTEND="noninteractive")
    for step in (["update"], ["install", "--yes", "--no-install-recommends", *packages]):
        if subprocess.run(["apt-get", "--quiet=2", *step], env=environment, stdout=subprocess.DEVNULL).returncode:
            raise SystemExit(fail("apt-get %s failed; install %s by hand and run make again." % (step[0], names)))


def say(text):
    """Print one progress line."""
    print("[set-up] " + text, flush=True)


def fail(text):
    """Print what is wrong and return the exit code for bad input."""
    print("[set-up] " + text, file=sys.stderr, flush=True)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
