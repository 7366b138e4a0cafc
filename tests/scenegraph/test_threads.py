"""Work on the nodes of a tree, side by side."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenegraph.threads import cores, upward


def forest(rng: np.random.Generator, count: int) -> list[int]:
    return [int(rng.integers(-1, node)) if node else -1 for node in range(count)]


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 4))
def test_every_node_is_worked_on_once_and_after_those_below(seed, count, workers):
    parent = forest(np.random.default_rng(seed), count)
    size, told = [0] * count, []

    def work(node: int) -> None:
        size[node] += 1 + sum(size[c] for c in range(node + 1, count) if parent[c] == node)

    def done(node: int) -> None:
        assert threading.current_thread() is threading.main_thread()
        told.append(node)

    upward(parent, work, done, workers)
    assert sorted(told) == list(range(count))
    assert sum(size[n] for n in range(count) if parent[n] < 0) == count
    place = {node: i for i, node in enumerate(told)}
    assert all(place[parent[n]] > place[n] for n in range(count) if parent[n] >= 0)


def test_nodes_that_do_not_wait_for_each_other_are_worked_on_at_the_same_time():
    meeting = threading.Barrier(2)
    # each waits until the other has come
    upward([-1, -1], lambda node: meeting.wait(timeout=60) and None, lambda node: None, 2)
    assert not meeting.broken


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("where", ["work", "done"])
def test_a_fault_ends_the_work_and_comes_out(where, workers):
    begun = []

    def work(node: int) -> None:
        begun.append(node)
        if where == "work" and node == 300:
            raise OSError("no")

    def done(node: int) -> None:
        if where == "done" and node == 300:
            raise KeyboardInterrupt

    # one above the other
    with pytest.raises(OSError if where == "work" else KeyboardInterrupt):
        upward(list(range(-1, 400)), work, done, workers)
    assert begun == list(range(400, 299, -1))
    assert not [t for t in threading.enumerate() if t.name.startswith("upward")]


def test_there_is_a_core():
    assert cores() >= 1
