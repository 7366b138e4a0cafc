"""OpenGL's query objects, called directly: moderngl neither frees them, nor says whether an answer is there, nor reads
the answers of any-samples queries (5.13).
"""

from __future__ import annotations

import ctypes
from collections import deque
from typing import Any

from .context import gl_function

SAMPLES_PASSED, ANY_SAMPLES_PASSED = 0x8914, 0x8C2F
_RESULT, _AVAILABLE = 0x8866, 0x8867

#: So many names wait before one is used again. Using a name anew frees what its last answer rested on; a software
#: renderer's threads may not be done with that yet when the answer can be read, least of all on a busy machine.
_RESTING = 256

_uint = ctypes.c_uint
_names = ctypes.POINTER(_uint)


class QueryObjects:
    """A pool of query objects of one context; every method must be called while the context is current.

    Parameters
    ----------
    window : vtkRenderWindow

    Attributes
    ----------
    made : int
        Query objects that exist in OpenGL.

    Raises
    ------
    GLError
        The functions cannot be looked up for this kind of window.
    """

    def __init__(self, window: Any) -> None:
        self._generate = gl_function(window, "glGenQueries", ctypes.c_int, _names)
        self._delete = gl_function(window, "glDeleteQueries", ctypes.c_int, _names)
        self._begin = gl_function(window, "glBeginQuery", _uint, _uint)
        self._end = gl_function(window, "glEndQuery", _uint)
        self._get = gl_function(window, "glGetQueryObjectuiv", _uint, _uint, _names)
        self._flush = gl_function(window, "glFlush")
        # OpenGL ties a name to the kind of query that it is first used for
        self._free: dict[int, deque[int]] = {SAMPLES_PASSED: deque(), ANY_SAMPLES_PASSED: deque()}
        self._answer = _uint()
        self.made = 0

    def take(self, count: int, kind: int) -> list[int]:
        """Names of query objects that nobody else uses, for one kind of query; those that rested longest."""
        free = self._free[kind]
        short = count + _RESTING - len(free)
        if short > 0:
            names = (_uint * short)()
            self._generate(short, names)
            # new ones first: the others go on resting
            free.extendleft(names)
            self.made += short
        # one by one: a ticket may be collected, and give its names back, at any time
        return [free.popleft() for _ in range(count)]

    def give_back(self, names: list[int], kind: int) -> None:
        """Let others use them."""
        self._free[kind].extend(names)

    def begin(self, name: int, kind: int) -> None:
        """Start counting."""
        self._begin(kind, name)

    def end(self, kind: int) -> None:
        """Stop counting."""
        self._end(kind)

    def flush(self) -> None:
        """Send all to the GPU, or an answer may never come."""
        self._flush()

    def is_available(self, name: int) -> bool:
        """Whether the answer is there."""
        self._get(name, _AVAILABLE, self._answer)
        return bool(self._answer.value)

    def value(self, name: int) -> int:
        """The answer; waits for it."""
        self._get(name, _RESULT, self._answer)
        return int(self._answer.value)

    def release(self) -> None:
        """Delete the free ones; those in use are deleted with the context."""
        for free in self._free.values():
            if free:
                self._delete(len(free), (_uint * len(free))(*free))
                self.made -= len(free)
                free.clear()
