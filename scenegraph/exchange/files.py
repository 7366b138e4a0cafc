"""Files that a model file names: material libraries, textures and buffers beside it."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

import trimesh


class Beside(trimesh.resolvers.Resolver):
    """Finds files relative to a model file, upward paths included, and remembers which it did not find.

    Parameters
    ----------
    model : Path
    """

    def __init__(self, model: Path) -> None:
        self.folder = model.parent
        self.missing: list[str] = []

    def get(self, key: str) -> bytes:
        """Content of a file; the name may be percent-encoded, have backslashes, or follow MTL options.

        Raises
        ------
        FileNotFoundError
            If no such file exists.
        """
        name = key.strip().replace("\\", "/")
        for candidate in dict.fromkeys((name, unquote(name), name.rsplit(" ", 1)[-1], name.rsplit("/", 1)[-1])):
            path = self.folder / candidate
            if candidate and path.is_file():
                return path.read_bytes()
        self.missing.append(key.strip())
        raise FileNotFoundError(key)

    def keys(self) -> list[str]:
        """Names of the files in the model's folder."""
        return sorted(p.name for p in self.folder.iterdir() if p.is_file())

    def namespaced(self, namespace: str) -> Beside:
        """The same for a folder below."""
        return Beside(self.folder / namespace / "model")

    def write(self, name: str, data: str | bytes) -> None:
        """Nothing is ever written beside a model."""
        raise PermissionError(f"{name} is not written: models are only read")
