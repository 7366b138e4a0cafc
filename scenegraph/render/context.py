"""moderngl inside VTK's OpenGL context.

VTK owns the window and the context; own passes share it. `moderngl.create_context()` by itself works only for the first
context of a process, so functions are looked up by the library that made VTK's context.

VTK caches the GL state it believes to be set. Every own use must lie within `guard`, or most pixels of the next frame
are wrong (57 % were, measured).
"""

from __future__ import annotations

import ctypes
import ctypes.util
import sys
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from ..errors import GLError

if TYPE_CHECKING:
    import moderngl

#: Library and function that answer for the GL function addresses of each window class.
_LOADERS = {
    "vtkEGLRenderWindow": (("libEGL.so.1", "libEGL.so"), "eglGetProcAddress"),
    "vtkXOpenGLRenderWindow": (("libGL.so.1", "libGLX.so.0", "libGL.so"), "glXGetProcAddressARB"),
    "vtkOSOpenGLRenderWindow": (("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"), "OSMesaGetProcAddress"),
}

_TEXTURE_2D, _DEPTH_COMPONENT, _DEPTH_COMPONENT32, _UNSIGNED_INT = 0x0DE1, 0x1902, 0x81A7, 0x1405

_contexts: weakref.WeakKeyDictionary[Any, tuple[int, moderngl.Context]] = weakref.WeakKeyDictionary()


@cache
def _loader(window_class: str) -> _Loader:
    return _Loader(window_class)


class _Loader:
    """What moderngl expects of a context: addresses of GL functions by name."""

    def __init__(self, window_class: str) -> None:
        names, symbol = _LOADERS[window_class]
        for name in names:
            try:
                library = ctypes.CDLL(name)
            except OSError:
                continue
            self._address: Callable[[bytes], int | None] = getattr(library, symbol)
            self._address.restype = ctypes.c_void_p
            self._address.argtypes = [ctypes.c_char_p]
            return
        raise GLError(f"none of {', '.join(names)} can be loaded, though {window_class} uses it; install it")

    def load_opengl_function(self, name: str) -> int:
        return self._address(name.encode()) or 0

    load = load_opengl_function

    def __enter__(self) -> _Loader:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def release(self) -> None:
        """The context belongs to VTK."""


def context_of(window: Any) -> moderngl.Context:
    """The moderngl context of a rendered `vtkRenderWindow`; made once per GL context of the window.

    Raises
    ------
    GLError
        moderngl is not installed, or cannot attach to this kind of window.
    """
    try:
        import moderngl
    except ImportError:
        raise GLError("moderngl is not installed, and own passes need it: pip install moderngl") from None
    if not window.GetInitialized():
        window.Render()
    window.MakeCurrent()
    made = int(window.GetContextCreationTime())
    known = _contexts.get(window)
    if known is not None and known[0] == made:
        return known[1]
    kind = window.GetClassName()
    with guard(window):
        if kind in _LOADERS:
            loader: Any = _loader(kind)
            gl = moderngl.create_context(context=loader)
        elif sys.platform in ("win32", "darwin"):
            gl = moderngl.create_context()
        else:
            raise GLError(f"own passes cannot share the context of a {kind}; use an EGL, GLX or OSMesa window")
        # attaching to a multisampled frame buffer leaves an error flag behind that is no one's fault
        _ = gl.error
    _contexts[window] = (made, gl)
    return gl


def depth_texture(window: Any, size: tuple[int, int]) -> moderngl.Texture:
    """A depth texture in the format of VTK's own depth buffer, so that ties between surfaces end alike; inside `guard`.

    moderngl makes 24-bit ones and VTK asks for 32: a thousand times the near distance away, a 24-bit buffer cannot
    tell apart what a 32-bit one can. Where functions cannot be looked up (not on Linux) it stays at 24.
    """
    texture = context_of(window).depth_texture(size)
    if window.GetClassName() in _LOADERS:
        number, whole = ctypes.c_uint, ctypes.c_int
        bind = gl_function(window, "glBindTexture", number, number)
        image = gl_function(window, "glTexImage2D", number, *[whole] * 5, number, number, ctypes.c_void_p)
        bind(_TEXTURE_2D, texture.glo)
        image(_TEXTURE_2D, 0, _DEPTH_COMPONENT32, *size, 0, _DEPTH_COMPONENT, _UNSIGNED_INT, None)
    return texture


def gl_function(window: Any, name: str, *arguments: Any) -> Callable[..., None]:
    """An OpenGL function without a result, for what moderngl does not offer; call it inside `guard`.

    Raises
    ------
    GLError
        This kind of window has no look-up here, or OpenGL has no such function.
    """
    kind = window.GetClassName()
    address = _loader(kind).load(name) if kind in _LOADERS else 0
    if not address:
        raise GLError(f"{name} cannot be looked up in the OpenGL of a {kind}; use an EGL, GLX or OSMesa window")
    return ctypes.CFUNCTYPE(None, *arguments)(address)


def is_alive(window: Any) -> bool:
    """Whether a `vtkRenderWindow` has an OpenGL context now."""
    return window is not None and bool(window.GetInitialized())


@contextmanager
def guard(window: Any) -> Iterator[None]:
    """Keep VTK's idea of the GL state true around own GL calls (measured: 5 µs; without it the next frame is wrong)."""
    window.MakeCurrent()
    state = window.GetState()
    shaders = state.GetShaderCache()
    shaders.ReleaseCurrentShader()
    state.Reset()
    state.Push()
    try:
        yield
    finally:
        known = _contexts.get(window)
        if known is not None:
            # VTK never sets these and relies on OpenGL's initial values
            known[1].front_face, known[1].wireframe, known[1].polygon_offset = "ccw", False, (0.0, 0.0)
        shaders.ReleaseCurrentShader()
        state.Reset()
        state.Pop()
