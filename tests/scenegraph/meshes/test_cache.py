"""The disk cache: what is stored comes back, what is damaged is dropped."""

from __future__ import annotations

import multiprocessing
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from scenegraph import Mesh
from scenegraph.meshes import DiskCache, FittedOccluders, cache_folder, fit_occluders

CUBE = Mesh.box((0, 0, 0), (1, 1, 1))
ARRAYS = {"a": np.arange(1000.0), "b": np.array([True, False])}


def same(a: dict[str, np.ndarray] | None, b: dict[str, np.ndarray]) -> bool:  # type: ignore[type-arg]
    return a is not None and a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in b)


def test_what_is_stored_is_loaded(tmp_path: Path) -> None:
    cache = DiskCache(tmp_path / "deep" / "down")
    assert cache.load("kind", "key") is None
    assert cache.store("kind", "key", ARRAYS)
    assert same(cache.load("kind", "key"), ARRAYS)
    assert cache.load("other", "key") is None
    assert [p.name for p in (tmp_path / "deep" / "down" / "kind").iterdir()] == ["key.npz"]


def test_keys_tell_content_version_and_settings_apart() -> None:
    keys = {
        DiskCache.key("mesh", 1, {"a": 1}),
        DiskCache.key("mesh", 1, {"a": 2}),
        DiskCache.key("mesh", 2, {"a": 1}),
        DiskCache.key("other", 1, {"a": 1}),
    }
    assert len(keys) == 4
    assert DiskCache.key("m", 1, {"a": 1, "b": 2}) == DiskCache.key("m", 1, {"b": 2, "a": 1})


@pytest.mark.parametrize("damage", ["empty", "cut", "flipped", "text", "zip", "pickle"])
def test_damaged_entries_are_dropped(tmp_path: Path, damage: str) -> None:
    cache = DiskCache(tmp_path)
    cache.store("kind", "key", ARRAYS)
    path = tmp_path / "kind" / "key.npz"
    data = bytearray(path.read_bytes())
    if damage == "empty":
        data.clear()
    elif damage == "cut":
        del data[len(data) // 2 :]
    elif damage == "flipped":
        data[len(data) // 3] ^= 0xFF
    elif damage == "text":
        data = bytearray(b"not an archive")
    elif damage == "zip":
        data = bytearray(b"PK\x05\x06" + bytes(18))
    if damage == "pickle":
        np.savez(path, a=np.array([{}], object))
    else:
        path.write_bytes(data)
    loaded = cache.load("kind", "key")
    assert loaded is None or loaded == {}
    assert cache.store("kind", "key", ARRAYS)
    assert same(cache.load("kind", "key"), ARRAYS)


def test_the_entries_used_longest_ago_go_first(tmp_path: Path) -> None:
    noise = {"a": np.random.default_rng(0).random(1000)}
    cache = DiskCache(tmp_path, limit_bytes=30_000)
    for i in range(3):
        cache.store("kind", f"{i}", noise)
        os.utime(tmp_path / "kind" / f"{i}.npz", (1000 + i, 1000 + i))
    assert cache.load("kind", "0") is not None  # used just now
    cache.store("kind", "3", noise)
    assert {p.stem for p in (tmp_path / "kind").iterdir()} == {"0", "2", "3"}
    assert cache.nbytes <= 30_000


def test_clear_takes_one_kind_or_all_and_leftovers_of_broken_writes(tmp_path: Path) -> None:
    cache = DiskCache(tmp_path)
    for kind in ("one", "two"):
        cache.store(kind, "key", ARRAYS)
        (tmp_path / kind / ".left.part").write_bytes(b"x" * 10)
    stranger = tmp_path / "one" / "notes.txt"
    stranger.write_text("mine")
    assert cache.clear("one") > 10
    assert cache.load("one", "key") is None
    assert same(cache.load("two", "key"), ARRAYS)
    cache.clear()
    assert cache.nbytes == 0
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [stranger]


def test_a_disk_that_takes_nothing_only_costs_time(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    cache = DiskCache(blocked / "below")
    assert not cache.store("kind", "key", ARRAYS)
    assert cache.load("kind", "key") is None
    assert cache.clear() == 0
    assert fit_occluders(CUBE, cells=12, cache=cache).occluders


def _write(folder: Path, value: int) -> None:
    for _ in range(20):
        DiskCache(folder).store("kind", "key", {"a": np.full(5000, value)})


def test_writers_at_the_same_time_leave_one_whole_entry(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=_write, args=(tmp_path, value)) for value in (1, 2)]
    for writer in writers:
        writer.start()
    cache = DiskCache(tmp_path)
    while any(writer.is_alive() for writer in writers):
        found = cache.load("kind", "key")
        assert found is None or (np.unique(found["a"]).size == 1 and found["a"].size == 5000)
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert [p.name for p in (tmp_path / "kind").iterdir()] == ["key.npz"]


@pytest.mark.skipif(sys.platform != "linux", reason="where caches are on Linux")
def test_the_folder_is_the_usual_one_or_the_given_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("SCENEGRAPH_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "scenegraph"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == tmp_path / "home" / ".cache" / "scenegraph"
    monkeypatch.setenv("SCENEGRAPH_CACHE_DIR", str(tmp_path / "mine"))
    assert cache_folder() == tmp_path / "mine"


# Fitting through the cache


def test_fitting_again_reads_what_was_written_and_gives_the_same() -> None:
    first = fit_occluders(CUBE, cells=12)
    again = fit_occluders(Mesh(CUBE.vertices, CUBE.faces, name="another"), cells=12)
    assert (first.is_cached, again.is_cached) == (False, True)
    assert first.summary() | {"is_cached": True} == again.summary()
    for a, b in zip(first.occluders, again.occluders, strict=True):
        assert (a.kind, a.two_sided, a.gain) == (b.kind, b.two_sided, b.gain)
        assert np.array_equal(a.points, b.points)
    assert not fit_occluders(CUBE, cells=13).is_cached
    assert not fit_occluders(CUBE, cells=12, refresh=True).is_cached
    assert not fit_occluders(CUBE, cells=12, cache=None).is_cached


def test_translucency_is_asked_before_the_cache() -> None:
    assert fit_occluders(CUBE, cells=12).occluders
    assert not fit_occluders(Mesh(CUBE.vertices, CUBE.faces, color=(1, 1, 1, 0.5)), cells=12).occluders


@pytest.mark.parametrize(
    "entry", [{}, {"points": np.zeros((3, 3))}, {"points": np.zeros(3), "meta": np.zeros(9, np.uint8)}]
)
def test_entries_that_make_no_sense_are_built_again(entry: dict[str, np.ndarray]) -> None:  # type: ignore[type-arg]
    fit_occluders(CUBE, cells=12)
    (path,) = cache_folder().glob("occluders/*.npz")
    DiskCache().store("occluders", path.stem, entry)
    assert not fit_occluders(CUBE, cells=12).is_cached
    assert fit_occluders(CUBE, cells=12).is_cached


def test_points_that_are_not_finite_are_not_taken_from_the_disk() -> None:
    fitted = fit_occluders(CUBE, cells=12)
    arrays = fitted.to_arrays()
    arrays["points"][0, 0] = np.nan
    with pytest.raises(ValueError, match="fit together"):
        FittedOccluders.from_arrays(arrays)


def test_no_solids_no_volume_survives_the_disk() -> None:
    sheet = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    first, again = fit_occluders(sheet), fit_occluders(sheet)
    assert again.is_cached
    assert np.isnan(first.volume_share)
    assert np.isnan(again.volume_share)
    assert first.notes == again.notes
