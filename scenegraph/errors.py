"""What the host raises for a user's eyes: one sentence that says what is wrong and what to do."""

from __future__ import annotations

from collections.abc import Iterable


class ScenegraphError(Exception):
    """Base of all errors that are the input's fault, not the program's. The command line exits with 2."""


class SceneError(ScenegraphError):
    """A scene, mesh or file that cannot be used."""


class GLError(ScenegraphError):
    """OpenGL is missing or lacks a feature; the message names the cure."""


class _ManyFaults(ScenegraphError):
    def __init__(self, what: str, faults: Iterable[str]) -> None:
        self.faults: tuple[str, ...] = tuple(faults)
        super().__init__(what + (": " if len(self.faults) == 1 else ":\n  - ") + "\n  - ".join(self.faults))


class PipelineError(_ManyFaults):
    """A pipeline that cannot run; `faults` holds every reason, one sentence each."""

    def __init__(self, faults: Iterable[str] | str) -> None:
        super().__init__("pipeline", [faults] if isinstance(faults, str) else faults)


class SuiteError(_ManyFaults):
    """A suite that cannot run; `faults` holds every reason, one sentence each."""

    def __init__(self, faults: Iterable[str] | str) -> None:
        super().__init__("suite", [faults] if isinstance(faults, str) else faults)


def nearest(name: str, known: Iterable[str]) -> str:
    """' Did you mean X?' for a misspelt name, or the list of what there is."""
    from difflib import get_close_matches

    names = sorted(known)
    close = get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f" Did you mean {close[0]!r}?"
    return f" Known: {', '.join(names)}." if names else " None are known."
