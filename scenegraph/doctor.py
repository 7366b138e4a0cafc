"""`scenegraph doctor`: what works here, what is missing, and how to get it."""

from __future__ import annotations

import platform
import re
import sys
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

DISTRIBUTION = "scenegraph-culling"


def examine() -> dict[str, Any]:
    """Look at Python, the packages, OpenGL and the plugins.

    Returns
    -------
    dict
        Plain values for JSON: "python", "packages", "gl", "plugins", and "cures", which holds one sentence for each
        thing that is missing; it is empty where all is well.
    """
    from scenegraph.registry import Registry
    from scenegraph.render.probe import probe

    gl = probe()
    packages = installed_packages()
    registry = Registry()
    cures = [
        f"The package {p['name']} is missing; install it with: pip install {p['name']}"
        for p in packages
        if p["version"] is None and not p["extra"]
    ]
    if not gl.ok:
        cures.append(f"Nothing can be drawn: {gl.message}")
    elif not gl.moderngl_ok:
        cures.append(f"Stages that draw by themselves cannot run, and truth takes longer: moderngl {gl.moderngl}")
    cures += [f"The plugin {f.name} {f.message}; update or uninstall it" for f in registry.failures]
    return {
        "python": {
            "version": platform.python_version(),
            "executable": sys.executable,
            "system": platform.platform(),
        },
        "packages": packages,
        "gl": gl.to_dict(),
        "plugins": {
            "stages": sorted(registry.stages),
            "scenes": sorted(registry.scenes),
            "failures": [{"name": f.name, "message": f.message} for f in registry.failures],
        },
        "cures": cures,
    }


def installed_packages() -> list[dict[str, Any]]:
    """List what this distribution asks for: name, version or None, and the extra that wants it ("" for all users)."""
    try:
        wanted = requires(DISTRIBUTION) or []
    except PackageNotFoundError:
        return [{"name": DISTRIBUTION, "version": None, "extra": ""}]
    found: dict[str, dict[str, Any]] = {}
    for requirement in wanted:
        name = re.split(r"[\s<>=!~;\[(]", requirement, maxsplit=1)[0]
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", requirement)
        if extra and extra[1] in ("dev", "docs"):
            continue
        try:
            have: str | None = version(name)
        except PackageNotFoundError:
            have = None
        found.setdefault(name, {"name": name, "version": have, "extra": extra[1] if extra else ""})
    return sorted(found.values(), key=lambda p: (p["extra"], p["name"]))


def show(findings: dict[str, Any], console: Console) -> None:
    """Print what `examine` found."""
    python, gl, plugins = findings["python"], findings["gl"], findings["plugins"]
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    table.add_row("Python", f"{python['version']}, {python['executable']}")
    table.add_row("system", python["system"])
    table.add_row("packages", _packages(findings["packages"], ""))
    for extra in sorted({p["extra"] for p in findings["packages"]} - {""}):
        table.add_row(f"extra [{extra}]".replace("[", "\\["), _packages(findings["packages"], extra))
    if gl["ok"]:
        drawn = "on the processor" if gl["is_software"] else "on the graphics card"
        table.add_row("OpenGL", f"{gl['renderer']}, {gl['version']}, drawn {drawn}")
        table.add_row("window", gl["window_class"])
        table.add_row("own passes", f"moderngl {gl['moderngl']}")
    else:
        table.add_row("OpenGL", Text("does not work", "bold red"))
        for name, ending in gl["tried"]:
            table.add_row("", f"{name}: {ending}")
    table.add_row("stages", ", ".join(plugins["stages"]) or "none")
    table.add_row("scenes", ", ".join(plugins["scenes"]) or "none")
    console.print(table)
    console.print()
    if not findings["cures"]:
        console.print(Text("Everything is in place.", "green"))
    for cure in findings["cures"]:
        console.print(Text(cure, "bold"), soft_wrap=True)


def _packages(packages: list[dict[str, Any]], extra: str) -> Text:
    text = Text()
    for package in packages:
        if package["extra"] != extra:
            continue
        if text:
            text.append(", ")
        if package["version"] is None:
            text.append(f"{package['name']} missing", "dim" if extra else "bold red")
        else:
            text.append(f"{package['name']} {package['version']}")
    return text
