"""Sphinx directives whose content comes from the installed package, so that a page cannot disagree with the code.

`{stage} NAME` shows what a stage declares: guarantee, reads, writes, needs and its parameters.
`{public}` documents every public name of `scenegraph`, `{kernels}` every kernel.
"""

from __future__ import annotations

import inspect
import pkgutil
import re
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import scenegraph
import scenegraph.kernels
from scenegraph.registry import Registry

REGISTRY = Registry()


class _Generated(SphinxDirective):
    def lines(self) -> list[str]:
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        content = StringList(self.lines(), source=self.get_source_info()[0])
        box = nodes.container()
        self.state.nested_parse(content, self.content_offset, box, match_titles=True)
        return box.children


class StageDirective(_Generated):
    """What a stage declares."""

    required_arguments = 1

    def lines(self) -> list[str]:
        stage = REGISTRY.stage(self.arguments[0])
        out = [stage.summary(), ""]
        out += ["| declares | |", "|---|---|", f"| guarantee by default | `{stage().guarantee.value}` |"]
        if stage.bound:
            out.append(f"| bound | {stage.bound} |")
        for what in ("reads", "writes", "needs"):
            names = ", ".join(f"`{n if isinstance(n, str) else n.__name__}`" for n in getattr(stage, what))
            out.append(f"| {what} | {names or 'nothing'} |")
        out.append("")
        rows = [
            f"| `{p.name}` | {p.type.__name__} | `{p.default!r}` | {_range(p)} | {p.unit or ''} | {p.help} |"
            for p in stage.parameters().values()
        ]
        if rows:
            out += ["| parameter | type | default | allowed | unit | meaning |", "|---|---|---|---|---|---|", *rows]
        else:
            out.append("It has no parameters.")
        return [*out, ""]


class PublicDirective(_Generated):
    """Autodoc entries for all of `scenegraph.__all__`."""

    def lines(self) -> list[str]:
        out = ["```{eval-rst}"]
        for name in scenegraph.__all__:
            thing = getattr(scenegraph, name)
            if isinstance(thing, int):
                out += [f".. py:data:: scenegraph.{name}", f"   :value: {thing}", "", "   A verdict on a box.", ""]
            elif isinstance(thing, type):
                out += [f".. autoclass:: scenegraph.{name}", "   :members:", ""]
            elif inspect.isfunction(thing):
                out += [f".. autofunction:: scenegraph.{name}", ""]
            else:
                out += [f".. py:data:: scenegraph.{name}", "", "   Marks the functions of a plugin that are hooks.", ""]
        return [*out, "```", ""]


class KernelsDirective(_Generated):
    """Autodoc entries for the modules of `scenegraph.kernels`."""

    def lines(self) -> list[str]:
        out = ["```{eval-rst}"]
        for module in sorted(m.name for m in pkgutil.iter_modules(scenegraph.kernels.__path__)):
            out += [f".. automodule:: scenegraph.kernels.{module}", "   :members:", ""]
        return [*out, "```", ""]


def _range(parameter: Any) -> str:
    if parameter.choices:
        return ", ".join(f"`{c!r}`" for c in parameter.choices)
    low, high = parameter.minimum, parameter.maximum
    if low is None and high is None:
        return "any"
    return f"{'' if low is None else f'{low:g}'} to {'' if high is None else f'{high:g}'}".strip()


def escape_bars(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Docstrings write |x| for a length or an absolute value; to Sphinx that is a substitution."""
    for i, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            parts = re.split(r"(`[^`]*`)", line)
            lines[i] = "".join(p if p.startswith("`") else p.replace("|", r"\|") for p in parts)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("stage", StageDirective)
    app.add_directive("public", PublicDirective)
    app.add_directive("kernels", KernelsDirective)
    app.connect("autodoc-process-docstring", escape_bars)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
