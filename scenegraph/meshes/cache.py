"""Derived data on disk, named by what it was derived from: built once, read ever after.

An entry is a file of arrays under a key that hashes everything the result depends on, so it never goes stale; the
version of the method is part of the key. Entries are written to a temporary name and moved, so that no reader sees
half a file; one that cannot be read is dropped and built again; a disk that is full or read-only only costs time. The
entries used longest ago go first when the folder grows beyond its limit.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..json_text import json_text

Arrays = dict[str, NDArray[Any]]

#: The folder, instead of the usual one.
FOLDER_VARIABLE = "SCENEGRAPH_CACHE_DIR"
DEFAULT_LIMIT_BYTES = 1 << 30


def cache_folder() -> Path:
    """Where derived data goes: $SCENEGRAPH_CACHE_DIR, else the platform's folder for caches of this user."""
    given = os.environ.get(FOLDER_VARIABLE)
    if given:
        return Path(given).expanduser()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        xdg = os.environ.get("XDG_CACHE_HOME", "")
        # the specification says to ignore a relative one
        base = Path(xdg) if xdg.startswith("/") else Path.home() / ".cache"
    return base / "scenegraph"


def _write(file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
    """As `np.savez_compressed`, which leaves no choice of the level.

    Level 1 takes two fifths of the time, for a hundredth more bytes at most.
    """
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)


class DiskCache:
    """Arrays by key.

    Parameters
    ----------
    folder : Path, optional
        `cache_folder()` if not given.
    limit_bytes : int
        Above this, entries are dropped, those used longest ago first.
    """

    def __init__(self, folder: Path | None = None, *, limit_bytes: int = DEFAULT_LIMIT_BYTES) -> None:
        self.folder = cache_folder() if folder is None else folder
        self.limit_bytes = limit_bytes

    @staticmethod
    def key(content: str, version: int, settings: Mapping[str, Any]) -> str:
        """Name of an entry.

        Parameters
        ----------
        content : str
            Hash of the input, such as `Mesh.key`.
        version : int
            Of the method; counted up whenever its results change.
        settings : mapping
            Everything else that the result depends on; plain values.
        """
        text = json_text([content, version, dict(settings)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:40]

    def _path(self, kind: str, key: str) -> Path:
        return self.folder / kind / f"{key}.npz"

    def load(self, kind: str, key: str) -> Arrays | None:
        """The arrays of an entry, or None if there is none that can be read.

        Parameters
        ----------
        kind : str
            Folder for entries of one sort.
        key : str
            See `key`.
        """
        path = self._path(kind, key)
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as entry:
                arrays = {name: entry[name] for name in entry.files}
        except FileNotFoundError:
            return None
        except Exception:  # readers raise whatever broken bytes lead them to
            self._drop(path)
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return arrays

    def store(self, kind: str, key: str, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Write an entry; False if the disk does not take it."""
        path = self._path(kind, key)
        written = ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, written = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
            with os.fdopen(handle, "wb") as file:
                _write(file, arrays)
            Path(written).replace(path)
        except OSError:
            self._drop(Path(written) if written else None)
            return False
        except BaseException:
            self._drop(Path(written) if written else None)
            raise
        self._shrink()
        return True

    def forget(self, kind: str, key: str) -> None:
        """Drop an entry, such as one whose content turned out to be wrong."""
        self._drop(self._path(kind, key))

    def clear(self, kind: str | None = None) -> int:
        """Drop all entries, or those of one kind; the bytes set free."""
        freed = 0
        for path, size, _ in self._entries(kind, leftovers=True):
            if self._drop(path):
                freed += size
        return freed

    @property
    def nbytes(self) -> int:
        """Size of all entries."""
        return sum(size for _, size, _ in self._entries(None))

    def _entries(self, kind: str | None, *, leftovers: bool = False) -> list[tuple[Path, int, float]]:
        found = []
        patterns = ("*.npz", ".*.part") if leftovers else ("*.npz",)
        with contextlib.suppress(OSError):
            for pattern in patterns:
                for path in self.folder.glob(f"{kind or '*'}/{pattern}"):
                    with contextlib.suppress(OSError):
                        stat = path.stat()
                        found.append((path, stat.st_size, stat.st_mtime))
        return found

    def _shrink(self) -> None:
        entries = self._entries(None)
        total = sum(size for _, size, _ in entries)
        for path, size, _ in sorted(entries, key=lambda e: (e[2], e[0].name)):
            if total <= self.limit_bytes:
                break
            if self._drop(path):
                total -= size

    @staticmethod
    def _drop(path: Path | None) -> bool:
        if path is None:
            return False
        try:
            path.unlink()
        except OSError:
            return False
        return True
