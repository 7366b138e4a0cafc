"""Opening a pipeline while a window stays alive.

A thread does the work. The loop of an interactive window holds Python's lock, so that a thread hardly ever gets a turn
(measured: 6 in 4 s); whoever owns the window calls `pump` from a timer, which sleeps, and so hands the lock over.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..pipeline import Pipeline
    from ..snapshot import Snapshot


class _StoppedError(Exception):
    """Nobody waits any more."""


class Preparation:
    """A pipeline being opened, in a thread or at once.

    Attributes
    ----------
    what : str
        What is being done.
    share : float
        How much of that is done, 0 to 1.
    error : Exception or None
        What it ended with.
    """

    def __init__(self, pipeline: Pipeline, snapshot: Snapshot, device: Any = None, *, in_thread: bool = True) -> None:
        self.what, self.share = "preparing", 0.0
        self.error: Exception | None = None
        self._stopped = False
        self._thread: threading.Thread | None = None
        if in_thread:
            self._thread = threading.Thread(target=self._work, args=(pipeline, snapshot, device), daemon=True)
            self._thread.start()
        else:
            self._work(pipeline, snapshot, device)

    def _work(self, pipeline: Pipeline, snapshot: Snapshot, device: Any) -> None:
        try:
            pipeline.open(snapshot, device=device, progress=self._tell)
        except _StoppedError:
            pass
        except Exception as error:
            # anything at all may go wrong in a stage; whoever waits decides
            self.error = error

    def _tell(self, what: str, share: float) -> None:
        if self._stopped:
            raise _StoppedError
        self.what, self.share = what, share

    @property
    def done(self) -> bool:
        """Whether the work has ended, well or not."""
        return self._thread is None or not self._thread.is_alive()

    def pump(self, seconds: float = 0.01) -> bool:
        """Let the work go on for so long, and say whether it has ended."""
        if self._thread is not None:
            self._thread.join(seconds)
        return self.done

    def stop(self) -> None:
        """End the work at its next sign of progress, and wait for that."""
        self._stopped = True
        if self._thread is not None:
            self._thread.join()
