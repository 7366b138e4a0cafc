"""Threads: one for BLAS in the frame loop, several for what is worked out beforehand.

Waking a second thread for a product of a few thousand boxes costs more than the product, and many times more when the
other cores are busy: `shadow` in the city took 0.7 ms a frame with one thread, and 0.8 to 30 ms with two.

Building is another matter: NumPy and SciPy release Python's lock in all that takes long, so that the nodes of a tree
can be worked on side by side.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cache
from types import TracebackType
from typing import Any

from threadpoolctl import ThreadpoolController

#: Workers at most: each has arrays of its own, and all wait for Python's lock between two operations.
WORKERS = 4


@cache
def _blas() -> tuple[Any, ...]:
    return tuple(ThreadpoolController().select(user_api="blas").lib_controllers)


class _OneThread(AbstractContextManager[None]):
    # threadpoolctl's own context asks every library for all that it knows: 15 µs of each frame
    def __enter__(self) -> None:
        self._before = [(library, library.get_num_threads()) for library in _blas()]
        for library, threads in self._before:
            if threads != 1:
                library.set_num_threads(1)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for library, threads in self._before:
            if threads != 1:
                library.set_num_threads(threads)


def one_blas_thread() -> AbstractContextManager[None]:
    """A context in which BLAS uses one thread; the number is restored afterwards."""
    return _OneThread()


def cores() -> int:
    """Cores that this process may use, which a container may have fewer of than the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def upward(parent: Sequence[int], work: Callable[[int], None], done: Callable[[int], None], workers: int = 0) -> None:
    """Work on every node of a forest after all nodes below it, on several at once if there are cores for them.

    Parameters
    ----------
    parent : sequence of int
        Node above each node, smaller than itself; negative where there is none.
    work : callable
        Called with a node, in any thread. What it leaves behind must not depend on the order beyond what is promised.
    done : callable
        Called with a node after it was worked on, in the calling thread; may raise to cancel.
    workers : int, optional
        Threads; as many as there are cores if not given, but no more than `WORKERS`.

    Raises
    ------
    BaseException
        The first that `work` or `done` raised, after the work that had begun has ended.
    """
    count = len(parent)
    workers = workers or min(cores(), WORKERS)
    if workers == 1:
        for node in range(count - 1, -1, -1):
            work(node)
            done(node)
        return
    # not needed to list the stages
    from concurrent.futures import Future, ThreadPoolExecutor
    from queue import SimpleQueue

    below = [0] * count
    for above in parent:
        if above >= 0:
            below[above] += 1
    finished: SimpleQueue[tuple[int, Future[None]]] = SimpleQueue()
    pool = ThreadPoolExecutor(workers, "upward")

    def begin(node: int) -> None:
        pool.submit(work, node).add_done_callback(lambda future: finished.put((node, future)))

    try:
        for node in range(count - 1, -1, -1):
            if not below[node]:
                begin(node)
        for _ in range(count):
            node, future = finished.get()
            future.result()
            done(node)
            above = parent[node]
            if above >= 0:
                below[above] -= 1
                if not below[above]:
                    begin(above)
    finally:
        pool.shutdown(cancel_futures=True)
