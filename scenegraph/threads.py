"""One BLAS thread for the small products of the frame loop.

Waking a second thread for a product of a few thousand boxes costs more than the product, and many times more when the
other cores are busy: `shadow` in the city took 0.7 ms a frame with one thread, and 0.8 to 30 ms with two.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from types import TracebackType
from typing import Any

from threadpoolctl import ThreadpoolController


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
