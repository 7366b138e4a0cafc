"""Which occluders are worth looking at from an eye: scores, and the best of them without scoring all.

Papaioannou et al. (2006), equations (3) and (4), after Coorg & Teller, "Real-time occlusion culling for models with
large occluders", I3D 1997. The printed (3) has the same vector V in numerator and denominator and so the unit of a
length, while (4) has none: which of two occluders wins would depend on the unit of the scene. By default V is a unit
vector in the numerator, as in Coorg & Teller, so that (3) is about a solid angle; and (4) is taken to the power 2/3,
which makes it about a solid angle, too, and leaves the order of solids as it is. Without that a polygon beats any
solid behind it that is not much nearer than its own size. In a parallel view nothing is nearer than anything else:
what counts there is the size of the image.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import View

from .catalog import Catalog

Floats = NDArray[np.float64]


class Scores:
    """Scores of occluders from one eye, found block by block as views ask for them.

    Views that share an eye share the scores: what one has looked at is not scored again for the next.

    Parameters
    ----------
    catalog : Catalog
    view : View
    measure : "area_angle", "printed" or "image"
        Unit-vector form of (3), and (4) to the power 2/3; (3) and (4) as printed; or half the surface over the
        squared distance, which is about the largest solid angle that a convex shape can have there.
    """

    def __init__(self, catalog: Catalog, view: View, measure: str) -> None:
        self.key = _key(catalog, view)
        self._catalog = catalog
        self._measure = measure
        self._eye = np.asarray(view.eye)
        self._forward = view.forward if view.is_parallel else None
        self.scored = 0
        ball = catalog.block_ball.copy()
        to_block = ball[:3]
        to_block -= self._eye[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            if self._forward is None:
                near = np.sqrt(np.add.reduce(to_block * to_block, axis=0))
                near -= catalog.block_radius
                np.maximum(near, 0.0, out=near)
            else:
                near = np.ones(to_block.shape[1])
            if measure == "image":
                bound = catalog.block_image / (near * near)
            elif measure == "printed" and not view.is_parallel:
                bound = np.fmax(catalog.block_area / near, (np.sqrt(catalog.block_bulk) / near) ** 3)
            else:
                bound = np.fmax(catalog.block_area, catalog.block_bulk) / (near * near)
        bound *= 1.0 + 1e-6
        #: No occluder of a block scores more; infinite where the eye may be among them.
        self.bound = np.fmax(bound, 0.0, out=bound)
        self._ball = ball
        self._found: list[tuple[NDArray[np.int64], Floats]] = []
        # kept only once a second view asks: most eyes have one
        self._score: Floats | None = None
        self._open = np.zeros(len(catalog.ids), bool)

    def fits(self, catalog: Catalog, view: View) -> bool:
        """Whether these are the scores for this view, too."""
        return self.key == _key(catalog, view)

    def _scored(self, blocks: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Scores of the occluders in blocks, and their balls (6, ...) relative to the eye, as `Catalog.ball`."""
        catalog = self._catalog
        ball = catalog.ball.take(blocks, axis=1)
        to = ball[:3]
        to -= self._eye[:, None, None]
        fresh = len(blocks)
        if self._score is not None:
            fresh -= int(np.count_nonzero(self._open.take(blocks)))
            if not fresh:
                return self._score.take(blocks, axis=0), ball
        with np.errstate(all="ignore"):
            way, squared = to, 1.0 if self._forward is not None else np.add.reduce(to * to, axis=0)
            printed = self._measure == "printed" and self._forward is None
            score = (catalog.image.take(blocks, axis=0) if self._measure == "image" else ball[5]) / squared
            if printed:
                score *= np.sqrt(score)
            if self._measure != "image" and catalog.has_polygons:
                if self._forward is not None:
                    way = self._forward[:, None, None]
                facing = -(catalog.area.take(blocks, axis=1) * way).sum(axis=0)
                facing = np.where(catalog.one_sided.take(blocks, axis=0), facing, np.abs(facing))
                score += facing / (squared if printed else squared * np.sqrt(squared))
            # not a number, or facing away
            np.fmax(score, 0.0, out=score)
            # what rounding alone tells apart counts as equal
            score = score.astype(np.float32).astype(np.float64)
        self.scored += fresh * score.shape[1]
        self._found.append((blocks, score))
        return score, ball

    def _keep(self) -> None:
        if self._score is None:
            self._score = np.zeros(self._catalog.ids.shape)
        for blocks, score in self._found:
            self._score[blocks] = score
            self._open[blocks] = True
        self._found.clear()

    def best(self, planes: Floats, count: int, hint: float = np.inf) -> tuple[NDArray[np.int64], float]:
        """The occluders with the highest scores that may be in a view.

        Parameters
        ----------
        planes : (p, 4) float64
            Planes of the view relative to the eye, inside is n·x + d ≥ 0.
        count : int
        hint : float
            The score that the last of them may have; a good guess saves time and changes nothing else.

        Returns
        -------
        ids : (up to count,) int64
            By falling score; equal ones by number.
        least : float
            The score of the last.
        """
        catalog = self._catalog
        if self._found:
            self._keep()
        # n·x + d + radius
        reaching = np.ones((len(planes), 5))
        reaching[:, :4] = planes
        unseen = np.where(np.minimum.reduce(reaching @ self._ball, axis=0) >= 0.0, self.bound, 0.0)
        ids: NDArray[np.int64] | None = None
        score, reached = np.zeros(0), 0.0
        # without a guess: twice as many blocks as would do if all their members counted
        share = 2 * -(-count // catalog.ids.shape[1])
        least = hint if hint < np.inf else _nth(unseen, share)
        while True:
            blocks = ((unseen >= least) & (unseen > 0.0)).nonzero()[0]
            if len(blocks):
                found, value = self._members(blocks, reaching)
                if ids is None:
                    ids, score = found, value
                else:
                    ids, score = np.concatenate([ids, found]), np.concatenate([score, value])
                reached = max(_nth(score, count), 0.0)
                unseen[blocks] = 0.0
            most = np.maximum.reduce(unseen, initial=0.0)
            if most == 0.0 or most < reached:
                break
            least = reached if reached > 0.0 else _nth(unseen, share)
        if ids is None:
            return np.zeros(0, np.int64), np.inf
        keep = (score >= reached).nonzero()[0]
        ids, score = ids.take(keep), score.take(keep)
        order = np.lexsort((ids, -score))[:count]
        return ids.take(order), float(score[order[-1]]) if len(order) else np.inf

    def _members(self, blocks: NDArray[np.int64], reaching: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Occluders of some blocks that may be in a view, and their scores."""
        catalog = self._catalog
        score, ball = self._scored(blocks)
        score = score.reshape(-1)
        inside = np.minimum.reduce(reaching @ ball[:5].reshape(5, -1), axis=0) >= 0.0
        inside &= score > 0.0
        good = inside.nonzero()[0]
        return catalog.ids.take(blocks, axis=0).reshape(-1).take(good), score.take(good)


def _nth(values: Floats, n: int) -> float:
    """The n-th largest value, or minus infinity if there are fewer."""
    if len(values) < n:
        return -np.inf
    values = values.copy()
    values.partition(len(values) - n)
    return float(values[len(values) - n])


def _key(catalog: Catalog, view: View) -> tuple[object, ...]:
    direction = tuple(view.forward.tolist()) if view.is_parallel else ()
    return (id(catalog), catalog.snapshot.version, view.eye, direction)
