"""Distances of a robot's shapes along a motion, and what they run into.

A pair's distance is computed only where bounds (:mod:`rpctl.robot.pair_motion`) leave open whether
it is told. What is told is that of all pairs at all samples of the log, within the resolution.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.obstacles import links_among
from rpctl.errors import RpctlError
from rpctl.robot.collision import TOUCH_M, WORLD, CollisionModel
from rpctl.robot.model import Robot
from rpctl.robot.pair_motion import approach_rates, ball_gaps, joint_motion, joint_travel
from rpctl.simulation.merits.collision_facts import (
    GROUND,
    SELF,
    Collision,
    CollisionFacts,
    LinkClearance,
)
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle, shape_text
from rpctl.simulation.merits.path_error import length

RESOLUTION_M = 1e-6  # m: distances that differ less are one, as coal's iterations leave more
BUDGET = 20_000  # distances, a tenth of a second, after which the resolution becomes coarser
COARSER = 4.0  # by this factor
STRIDE_M = 0.1  # m: how far a pair can approach from one surveyed sample to the next
BLOCK = 256  # samples that are surveyed at once
INSTANTS = 200  # of the series, at most


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A robot's shapes among the ground and obstacles.

    Attributes:
        model: The shapes and pairs.
        things: What the pairs are with: ``SELF``, ``GROUND``, and each obstacle in words.
        thing: Index into ``things`` of each pair (n,).
    """

    model: CollisionModel
    things: tuple[str, ...]
    thing: NDArray[np.intp]


def surroundings(robot: Robot, obstacles: Sequence[AvoidedObstacle]) -> Surroundings:
    """Return a robot's shapes among obstacles.

    Args:
        robot: The robot.
        obstacles: Of its laws.
    """
    base, tip = ([each.shape for each in obstacles if each.body == body] for body in (BASE, TIP))
    model = links_among(robot, base, tip)
    ground = len(model.shapes) - 1 - len(base) - len(tip)
    second = model.pairs[:, 1]
    thing = np.where(second < ground, 0, 1 + second - ground).astype(np.intp)
    names = [f"the {shape_text(shape)}" for shape in (*base, *tip)]
    return Surroundings(model, (SELF, GROUND, *names), thing)


def require_clear_start(around: Surroundings, q: Array) -> None:
    """Refuse to start inside an obstacle.

    Args:
        around: The robot among its obstacles.
        q: Where it starts (nq,).

    Raises:
        RpctlError: A link is in an obstacle; how deep, and what to do, is told.
    """
    distances = around.model.distances()
    distances.place(q)
    pairs = np.flatnonzero(around.thing > 1).tolist()
    if not pairs:
        return
    depth, pair = min((distances.distance(pair), pair) for pair in pairs)
    if depth < -TOUCH_M:
        link = around.model.shapes[around.model.pairs[pair, 0]].link
        raise RpctlError(
            f"the robot starts inside an obstacle: {link} is {length(-depth)} deep in "
            f"{around.things[around.thing[pair]]}; start elsewhere (--initial-error), or move "
            "the obstacle or the reference"
        )


def find_collisions(around: Surroundings, t: Array, q: Array) -> CollisionFacts:
    """Return how near a robot came to things along a motion, and what it ran into.

    Args:
        around: The robot among its obstacles.
        t: Time (K,), s.
        q: Configurations (K, nq).
    """
    scan = _Scan(around, t, q)
    scan.run()
    return scan.facts()


def _of_links(collisions: Sequence[Collision]) -> list[Collision]:
    """Return one collision of each two links: a link may have several shapes."""
    found: dict[tuple[str, str, str], Collision] = {}
    for each in collisions:
        known = found.setdefault((each.to, each.link, each.other), each)
        found[each.to, each.link, each.other] = replace(
            each,
            depth=max(known.depth, each.depth),
            first_time=min(known.first_time, each.first_time),
            duration=max(known.duration, each.duration),
        )
    return list(found.values())


class _Scan:
    """Looks for the least distances along a motion.

    First at instants that are so near to each other that a pair approaches little between two. How
    far apart its balls are, and how far it was and can have moved on since, are bounds that spare
    most looks. Where between two instants a pair can be nearer than its thing was, or touch, it is
    then looked at in between, the likeliest first, until its bounds tell.

    Args:
        around: The robot among its obstacles.
        t: Time (K,), s.
        q: Configurations (K, nq).
    """

    def __init__(self, around: Surroundings, t: Array, q: Array) -> None:
        self._around, self._t, self._q = around, t, q
        self._distances, self._placed = around.model.distances(), -1
        count, things = len(around.thing), len(around.things)
        self._thing = around.thing.tolist()
        self._pairs_of = [np.flatnonzero(around.thing == thing) for thing in range(things)]
        self._looks = defaultdict[int, dict[int, float]](dict)  # distances of a pair by sample
        self._resolution, self._left = RESOLUTION_M, BUDGET
        self._distance = np.full(count, -np.inf)  # of each pair when it was looked at last
        self._looked = np.zeros(count)  # its path then, m
        self._deepest = [TOUCH_M] * count
        self._least = [np.inf] * things
        self._nearest = [(0, 0)] * things  # sample and pair of the least distance
        self._instants = np.unique(np.linspace(0, len(t) - 1, INSTANTS).astype(int))
        self._series = np.full((things, len(self._instants)), np.inf)

    def run(self) -> None:
        """Look for the least distances."""
        robot, count = self._around.model.robot, len(self._around.thing)
        if not count:
            return
        rates = approach_rates(self._around.model, joint_travel(robot, self._q))
        ways = np.zeros((len(self._q), rates.shape[1]))
        np.cumsum(joint_motion(robot, self._q), axis=0, out=ways[1:])
        farthest = ways @ rates.max(axis=0)
        stops = farthest.searchsorted(np.arange(0.0, farthest[-1], STRIDE_M))
        samples = np.unique([*self._instants, *stops])
        found = [
            self._survey(samples[first : first + BLOCK + 1], ways, rates)
            for first in range(0, max(len(samples) - 1, 1), BLOCK)
        ]
        spans = np.hstack(found)
        for low, pair, first, last in spans[:, spans[0].argsort()].T:
            if low < self._threshold(int(pair)):
                self._follow(
                    int(pair), int(first), ways[int(first) : int(last) + 1] @ rates[int(pair)]
                )

    def _survey(self, samples: NDArray[np.intp], ways: Array, rates: Array) -> Array:
        """Bound the distances at some samples, and compute those that are shown.

        Returns:
            Where to look on (4, spans): the least that a pair's distance can be between two of the
            samples, the pair, the one sample and the other.
        """
        rows = ways[samples][:, None]  # each a product of its own: BLAS's threads cost more
        paths = (rows @ rates.T)[:, 0]  # (samples, n)
        bounds = np.ascontiguousarray(ball_gaps(self._around.model, self._q[samples]).T)
        columns = dict(zip(self._instants.tolist(), range(len(self._instants)), strict=True))
        for k, path, bound in zip(samples.tolist(), paths, bounds, strict=True):
            np.maximum(bound, self._distance - (path - self._looked), out=bound)
            if k in columns:
                self._series[:, columns[k]] = self._show(k, path, bound)
        low = 0.5 * (bounds[:-1] + bounds[1:] - np.diff(paths, axis=0))
        threshold = np.array([self._threshold(pair) for pair in range(len(rates))])
        spans, pairs = np.nonzero(low < threshold)
        return np.array([low[spans, pairs], pairs, samples[spans], samples[spans + 1]])

    def _show(self, k: int, path: Array, bound: Array) -> list[float]:
        """Return the distance of each thing at a sample; the bounds of pairs become distances."""
        found = []
        for pairs in self._pairs_of:
            least, bounds = np.inf, bound[pairs]
            while len(pairs) and bounds[nearest := int(bounds.argmin())] < least:
                pair = int(pairs[nearest])
                self._distance[pair] = bound[pair] = distance = self._look(pair, k)
                self._looked[pair] = path[pair]
                least, bounds[nearest] = min(least, distance), np.inf
            found.append(least)
        return found

    def _look(self, pair: int, k: int) -> float:
        """Return the distance of a pair at a sample."""
        looks, thing = self._looks[pair], self._thing[pair]
        if k in looks:
            return looks[k]
        if k != self._placed:
            self._distances.place(self._q[k])
            self._placed = k
        distance = looks[k] = self._distances.distance(pair)
        if distance < self._least[thing]:
            self._least[thing], self._nearest[thing] = distance, (k, pair)
        self._deepest[pair] = max(self._deepest[pair], -distance)
        self._left -= 1
        if not self._left:
            self._left, self._resolution = BUDGET, COARSER * self._resolution
        return distance

    def _threshold(self, pair: int) -> float:
        """Return the distance of a pair above which nothing is to be told of it."""
        return max(self._least[self._thing[pair]] - self._resolution, -TOUCH_M)

    def _follow(self, pair: int, first: int, path: Array) -> None:
        """Look at a pair between two samples wherever it may say more.

        Args:
            pair: The pair.
            first: Number of the one sample.
            path: How far the pair can have approached at each, the other included (samples,), m.
        """
        spans = [(0, len(path) - 1)]
        while spans:
            a, b = spans.pop()
            near, far = self._look(pair, first + a), self._look(pair, first + b)
            way = float(path[b] - path[a])
            if b - a > 1 and way > self._resolution and self._tells(pair, near + far, way):
                goal = path[a] + 0.5 * (way + near - far)  # there it would be nearest
                middle = min(max(int(path.searchsorted(goal)), a + 1), b - 1)
                spans += [(middle, b), (a, middle)]

    def _tells(self, pair: int, ends: float, way: float) -> bool:
        """Return whether a pair may be nearest, deepest, or begin or cease to touch on a way.

        Args:
            pair: The pair.
            ends: The sum of its distances at both ends, m.
            way: How far it can approach or part, m.
        """
        low, high = 0.5 * (ends - way), 0.5 * (ends + way)
        if low < self._least[self._thing[pair]] - self._resolution:
            return True
        inside = high < -TOUCH_M and low >= -self._deepest[pair] - self._resolution
        return low < -TOUCH_M and not inside

    def facts(self) -> CollisionFacts:
        """Return what was found."""
        model = self._around.model
        known = [thing for thing in range(len(self._least)) if np.isfinite(self._least[thing])]
        clearances = []
        for thing in known:
            k, pair = self._nearest[thing]
            names = self._names(pair)
            clearances.append(
                LinkClearance(*names[:1], float(self._least[thing]), float(self._t[k]), *names[1:])
            )
        touching = [pair for pair, depth in enumerate(self._deepest) if depth > TOUCH_M]
        collisions = _of_links([self._collision(pair) for pair in touching])
        return CollisionFacts(
            tuple(clearances),
            tuple(sorted(collisions, key=lambda each: -each.depth)),
            tuple((each.first, each.second, each.why) for each in model.allowed),
            model.notes,
            self._resolution,
            tuple(self._t[self._instants].tolist()),
            tuple(tuple(self._series[thing].tolist()) for thing in known),
        )

    def _collision(self, pair: int) -> Collision:
        """Return what there is to tell of a pair that touched."""
        samples = sorted(self._looks[pair])
        inside = np.array([self._looks[pair][k] < -TOUCH_M for k in samples])
        t = self._t[samples]
        lasted = float(np.diff(t, append=self._t[-1])[inside].sum())
        return Collision(*self._names(pair), self._deepest[pair], float(t[inside][0]), lasted)

    def _names(self, pair: int) -> tuple[str, str, str]:
        """Return what a pair is with, its link, and the other link."""
        shapes = self._around.model.shapes
        first, second = (shapes[k] for k in self._around.model.pairs[pair])
        other = "" if second.joint == WORLD else second.link
        return self._around.things[self._around.thing[pair]], first.link, other
