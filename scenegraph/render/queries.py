"""Occlusion queries: how many samples of each of some boxes lie in front of what a depth target holds.

Two ways, with the same answers. *Query objects*: one for each box, asynchronous, `issue` and later `result`. *Batched*:
all boxes in one draw call whose fragment shader counts into a shader storage buffer, `count`; it needs OpenGL 4.3.
Without, or where it fails a test at first use, query objects stand in, and `fallback` and the log say so.

What is promised: a box that gets 0 holds nothing that, drawn by the same OpenGL at the resolution of the target and
with one sample at the center of a pixel, would pass its depth test there. `scenegraph.kernels.proxies` says by how much
boxes are grown for that, and why. A picture with more samples than the target may show what lies between the target's
samples: against such a picture nothing is promised; ask with a target of that many samples.

Answers are not believed blindly. One that is no count, is negative or larger than the target, comes in the wrong number
or not within `patience` is replaced by the number of all samples, as for boxes that are not asked. A batch contains a
known box of its own; if that is not seen, none of the batch's answers is believed. A wrong answer that looks like
a right one cannot be told from it.

Boxes are made ready for OpenGL in double precision by the CPU (0.1 µs each) and drawn as one mesh, without instances:
then 8 corners of each are transformed, and not 36.
"""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import GLError
from ..kernels.proxies import TRIANGLES, box_clip_corners
from .box_drawing import BoxDrawing, known_box, testing_only, wide_box
from .context import is_alive
from .layout import F32, F64, I64, Mask
from .query_objects import ANY_SAMPLES_PASSED, SAMPLES_PASSED, QueryObjects

if TYPE_CHECKING:
    import moderngl

    from ..view import View
    from .device import DepthTarget, Device

_log = logging.getLogger(__name__)

#: OpenGL with shader storage buffers and `early_fragment_tests`.
BATCHED_SINCE = 430

#: Pixels by which OpenGL may shift a corner at most: its coarsest grid has 16 steps per pixel.
COARSEST_STEP = 2**0.5 / 16


class Ticket:
    """Boxes that have been asked about by query objects. Made by `BoxQueries.issue`.

    Attributes
    ----------
    unknown : (k,) bool
        Boxes that were not asked, because they count as visible.
    samples : int
        Of the target; the answer for unknown boxes.
    """

    def __init__(self, gl: Any, pool: Any, kind: int, unknown: Mask, samples: int) -> None:
        self.gl = gl
        self.pool = pool
        self.kind = kind
        self.unknown = unknown
        self.samples = samples
        self.largest = samples
        self.answers: I64 = np.full(len(unknown), samples, np.int64)
        #: Positions of the boxes that wait for an answer, and the query objects that will have it.
        self.waiting: list[int] = []
        self.names: list[int] = []

    def __len__(self) -> int:
        return len(self.unknown)

    def __del__(self) -> None:
        # a ticket that nobody has asked for its result
        self.done()

    def done(self) -> None:
        """Let others use the query objects."""
        if self.names:
            self.pool.give_back(self.names, self.kind)
        self.waiting, self.names = [], []


class BoxQueries:
    """The queries of one device. Every method but `unknown` must be called inside `Device.guard`.

    Parameters
    ----------
    device : Device

    Attributes
    ----------
    fallback : str
        Why `count` uses query objects; empty while it need not.
    patience : float
        Seconds after which `result` gives up on answers that have not come.
    distrusted : int
        Answers that were replaced by "visible" so far, because they could not be right or did not come.
    objects : QueryObjects
        Where the answers of `result` come from; None before the first query of a context.

    Examples
    --------
    ::

        with frame.device.guard():
            target = frame.device.depth_target(frame.view.width, frame.view.height)
            frame.device.draw_depth(target, frame.view, frame.snapshot, occluders)
            samples = frame.device.queries.count(frame.view, boxes, target)
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self.fallback = ""
        self.patience = 2.0
        self.distrusted = 0
        self.objects: Any = None
        self._gl: moderngl.Context | None = None
        self._boxes: BoxDrawing | None = None
        self._step = 0.0
        self._is_tested = False

    def unknown(self, view: View, boxes: F64) -> Mask:
        """(k,) boxes that are not asked: across the near plane, around the eye, or not finite. They are visible."""
        return self._corners(view, boxes, view.width, view.height)[1]

    # -- one query object per box -----------------------------------------------------------------------------------

    def issue(
        self,
        view: View,
        boxes: F64,
        target: DepthTarget,
        *,
        any_samples: bool = False,
        margin: float = 0.0,
        groups: NDArray[np.integer] | None = None,
    ) -> Ticket:
        """Ask about boxes without waiting; nothing is written into the target.

        Parameters
        ----------
        view : View
            Its image is fitted to the target.
        boxes : (6, k) float64
            World boxes, components first.
        target : DepthTarget
        any_samples : bool
            Ask whether, not how many: answers are 0, 1, or the number of all samples for unknown boxes.
        margin : float
            Pixels of the target by which boxes are grown on the screen beyond what is promised. From 1/2 on no box
            falls between samples.
        groups : (g + 1,) int, optional
            One query for the boxes [groups[i], groups[i + 1]) together, whose samples are added up; unknown if one of
            them is, or there are none. Without, one query for each box.
        """
        gl, drawn = self._attach()
        corners, unknown = self._corners(view, boxes, target.width, target.height, margin)
        first = np.arange(len(unknown) + 1) if groups is None else np.asarray(groups, np.int64)
        before = np.concatenate([[0], np.cumsum(unknown)])
        unknown = (before[first[1:]] > before[first[:-1]]) | (first[1:] <= first[:-1])
        kind = ANY_SAMPLES_PASSED if any_samples else SAMPLES_PASSED
        ticket = Ticket(gl, self._pool(), kind, unknown, target.width * target.height)
        ticket.largest = ticket.samples * int(np.diff(first).max(initial=1))
        ticket.waiting = np.flatnonzero(~unknown).tolist()
        if ticket.waiting:
            ticket.names = self.objects.take(len(ticket.waiting), kind)
            self._ask(drawn, corners, (len(TRIANGLES) * first).tolist(), ticket, target)
        return ticket

    def _ask(self, drawn: BoxDrawing, corners: F32, first: list[int], ticket: Ticket, target: DepthTarget) -> None:
        begin, end = self.objects.begin, self.objects.end
        drawn.load(corners)
        with testing_only(drawn.gl, target):
            for position, name in zip(ticket.waiting, ticket.names, strict=True):
                begin(name, ticket.kind)
                drawn.plain.render(vertices=first[position + 1] - first[position], first=first[position])
                end(ticket.kind)
        self.objects.flush()

    def ready(self, ticket: Ticket) -> Mask:
        """(k,) which answers can be had without waiting."""
        done = np.ones(len(ticket), bool)
        if ticket.waiting and self._is_current(ticket):
            available = self.objects.is_available
            done[ticket.waiting] = [available(name) for name in ticket.names]
        return done

    def result(self, ticket: Ticket) -> I64:
        """(k,) samples that each box has in front of the target; waits for what is not ready, at most `patience`.

        Boxes of a ticket whose context is lost are visible.
        """
        if ticket.waiting:
            raw = self._collected(ticket) if self._is_current(ticket) else []
            answers = self._believed(raw, len(ticket.waiting), ticket.largest)
            ticket.answers[ticket.waiting] = np.minimum(answers, 1) if ticket.kind == ANY_SAMPLES_PASSED else answers
            ticket.done()
        return ticket.answers

    def _collected(self, ticket: Ticket) -> list[Any]:
        deadline = time.monotonic() + self.patience
        raw: list[Any] = []
        for name in ticket.names:
            while not (has_come := self.objects.is_available(name)) and time.monotonic() < deadline:
                time.sleep(0)
            raw.append(self.objects.value(name) if has_come else None)
        return raw

    # -- all boxes in one draw --------------------------------------------------------------------------------------

    def count(
        self, view: View, boxes: F64, target: DepthTarget, *, any_samples: bool = False, margin: float = 0.0
    ) -> I64:
        """(k,) samples that each box has in front of the target, by one draw call; for parameters see `issue`.

        Counting needs an atomic operation for each sample; asking only for `any_samples` does not, and costs half as
        much where many are seen.
        """
        gl, _ = self._attach()
        if not self._is_tested:
            self.fallback = self._why_not_batched(gl)
            self._is_tested = True
            if self.fallback:
                _log.warning("occlusion queries are asked one by one: %s", self.fallback)
        if self.fallback:
            return self.result(self.issue(view, boxes, target, any_samples=any_samples, margin=margin))
        corners, unknown = self._corners(view, boxes, target.width, target.height, margin)
        k, samples = len(unknown), target.width * target.height
        # the known box comes last: the others keep their numbers
        way = "mark" if any_samples else "count"
        raw = self.read_counts(np.concatenate([corners, known_box(target)]), target, way)
        answers = self._believed(raw, k + 1, samples)
        if k and answers[k] == 0:
            _log.warning("a box next to the near plane was not counted; %d boxes count as visible", k)
            self.distrusted += k
            answers[:] = samples
        answers[:k][unknown] = samples
        return answers[:k]

    def read_counts(self, corners: F32, target: DepthTarget, way: str = "count") -> NDArray[np.uint32]:
        """(k,) what the shader counts, or marks, for boxes given by their corners (k, 8, 4) in clip space."""
        gl, drawn = self._attach()
        drawn.load(corners)
        counts = drawn.cleared_counts(len(corners))
        with testing_only(gl, target):
            counts.bind_to_storage_buffer(0)
            drawn.counting(way).render(vertices=len(TRIANGLES) * len(corners))
        # without both, what is read may be older than what was drawn
        gl.memory_barrier()
        gl.finish()
        return np.frombuffer(counts.read(4 * len(corners)), np.uint32)

    def _why_not_batched(self, gl: moderngl.Context) -> str:
        if self.device.version_code < BATCHED_SINCE:
            return f"OpenGL {self.device.version_code / 100:.1f} has no shader storage buffers; 4.3 has"
        target = self.device.depth_target(8, 8)
        target.clear(0.5)
        try:
            near, far = self.read_counts(np.concatenate([wide_box(-0.5), wide_box(0.5)]), target)
        except Exception as error:
            return f"counting in a shader fails: {error}"
        return "" if near == 64 and far == 0 else f"a shader counts {near} and {far} samples where 64 and 0 are right"

    # -- the rest -----------------------------------------------------------------------------------------------------

    def _attach(self) -> tuple[moderngl.Context, BoxDrawing]:
        if not is_alive(self.device.window):
            raise GLError("the window of these occlusion queries is closed; ask in a window that is open")
        gl = self.device.gl
        if gl is not self._gl or self._boxes is None:
            # what was made in a lost context went with it
            self._gl, self._boxes, self.objects, self._is_tested = gl, BoxDrawing(gl), None, False
            self._step = float(np.sqrt(2)) * 2.0 ** -int(gl.info["GL_SUBPIXEL_BITS"])
        return gl, self._boxes

    def _pool(self) -> Any:
        if self.objects is None:
            self.objects = QueryObjects(self.device.window)
        return self.objects

    def _is_current(self, ticket: Ticket) -> bool:
        if is_alive(self.device.window) and self.device.gl is ticket.gl and ticket.pool is self.objects:
            return True
        _log.warning("the OpenGL context of %d queries is gone; their boxes count as visible", len(ticket.waiting))
        return False

    def _corners(self, view: View, boxes: F64, width: int, height: int, margin: float = 0.0) -> tuple[F32, Mask]:
        left, right, bottom, top = view.window
        return box_clip_corners(
            np.asarray(boxes, np.float64).reshape(6, -1),
            axes=view.axes,
            eye=np.asarray(view.eye),
            projection=view.projection(),
            pixels=(width / (right - left), height / (top - bottom)),
            margin=margin,
            step=(self._step or COARSEST_STEP) + float(np.finfo(np.float32).eps) * max(width, height),
            reach=self.device.reach(view),
            near=view.near,
            parallel=view.is_parallel,
        )

    def _believed(self, raw: ArrayLike, expected: int, largest: int) -> I64:
        """Answers as they came, with the largest possible one in the place of those that cannot be right."""
        try:
            values = np.asarray(raw, np.float64).ravel()
        except (TypeError, ValueError, OverflowError):
            values = np.zeros(0)
        if len(values) != expected:
            values = np.full(expected, np.nan)
        with np.errstate(invalid="ignore"):
            good = (values >= 0) & (values <= largest) & (values == np.floor(values))
        self.distrusted += expected - int(np.count_nonzero(good))
        return np.where(good, values, largest).astype(np.int64)

    def close(self) -> None:
        """Free what OpenGL holds for these queries, if the context is alive."""
        if self._boxes is not None and is_alive(self.device.window):
            self._boxes.release()
            if self.objects is not None:
                self.objects.release()
        self._gl, self._boxes, self.objects, self._is_tested = None, None, None, False
