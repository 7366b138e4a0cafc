"""Does a stage pay for itself? Its measured time against the drawing time that it saves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from .log import StageRecord

#: Weight of the newest measurement (VTK's level-of-detail props use the same).
NEW = 0.75

#: Frames on trial; the longest pause that trials lead to by failing again and again, and by being dear.
TRIAL, LONGEST, DEAREST = 3, 64, 256

#: Share of a frame's drawing time that trials may cost on average.
SHARE = 0.01


@dataclass
class _Account:
    ms: float = 0.0
    saved_ms: float = 0.0
    runs: int = 0
    pause: int = 0
    resume_at: int = 0


@dataclass
class Worth:
    """Running averages of cost and benefit per stage, in milliseconds.

    Attributes
    ----------
    ms_per_object, ms_per_triangle : float
        What drawing costs, from `drawn`; 0 until it is known, and then no stage is ever skipped.
    """

    ms_per_object: float = 0.0
    ms_per_triangle: float = 0.0
    _frame_ms: float = 0.0
    _accounts: dict[str, _Account] = field(default_factory=dict)

    def drawn(self, *, objects: int, triangles: int, ms: float) -> None:
        """Tell what a frame's drawing cost; half is put down to objects, half to triangles."""
        self._frame_ms = _mixed(self._frame_ms, ms)
        for name, amount in (("ms_per_object", objects), ("ms_per_triangle", triangles)):
            if amount > 0:
                setattr(self, name, _mixed(getattr(self, name), 0.5 * ms / amount))

    def ran(self, record: StageRecord, readers: Iterable[StageRecord] = ()) -> None:
        """Account for a frame in which a stage ran.

        Parameters
        ----------
        record : StageRecord
        readers : iterable of StageRecord
            Stages that worked with what it has put into the frame: without it, neither their time nor what they save.
        """
        account = self._accounts.setdefault(record.name, _Account())
        all_records = [record, *readers]
        account.ms = _mixed(account.ms, sum(r.ms for r in all_records))
        account.saved_ms = _mixed(account.saved_ms, sum(map(self.saves, all_records)))
        account.runs += 1

    def saves(self, record: StageRecord) -> float:
        """Milliseconds of drawing that a stage has saved in a frame."""
        triangles = record.triangles_before - record.triangles_after
        return record.hidden * self.ms_per_object + triangles * self.ms_per_triangle

    def skip(self, name: str, index: int) -> str | None:
        """Why a stage should not run in frame `index`, or None.

        Pauses double as long as trials keep failing, and are long enough for what a trial costs.
        """
        account = self._accounts.get(name)
        if account is None or not self.ms_per_triangle:
            return None
        if index < account.resume_at:
            return (
                f"costs {account.ms:.2f} ms, saves {account.saved_ms:.2f} ms; tried again at frame {account.resume_at}"
            )
        if account.runs >= TRIAL and account.saved_ms < account.ms:
            enough = (account.ms - account.saved_ms) / (SHARE * self._frame_ms)
            account.pause = max(min(max(2 * account.pause, 4), LONGEST), int(min(enough, DEAREST)))
            account.resume_at, account.runs = index + account.pause, TRIAL - 1
            return self.skip(name, index)
        if account.runs >= TRIAL:
            account.pause = 0
        return None


def _mixed(old: float, new: float) -> float:
    return new if old == 0.0 else (1 - NEW) * old + NEW * new
