"""How long work tells how far it is, without knowing who listens."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called with what is being done and the share done in 0..1; may raise to cancel."""

    def __call__(self, what: str, share: float) -> None:
        """Take note."""


def silent(what: str, share: float) -> None:
    """A progress that tells nobody."""
