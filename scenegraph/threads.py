"""One BLAS thread for the small products of the frame loop.

Waking a second thread for a product of a few thousand boxes costs more than the product, and many times more when the
other cores are busy: `shadow` in the city takes 0.7 ms a frame with one thread, and 0.8 to 30 ms with two.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


@cache
def _blas() -> Any:
    return ThreadpoolController().select(user_api="blas")


def one_blas_thread() -> AbstractContextManager[Any]:
    """A context in which BLAS uses one thread; the number is restored afterwards."""
    limited: AbstractContextManager[Any] = _blas().limit(limits=1)
    return limited
