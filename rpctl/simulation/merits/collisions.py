"""Distances of a robot's shapes along a motion, and what they run into.

A pair's distance is computed only where it can have become interesting: between two samples it
falls by no more than the joints' motion allows (:mod:`rpctl.robot.pair_motion`), so the samples in
between need no look. No collision deeper than ``TOUCH_M`` and the resolution is missed at any
sample of the log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.obstacles import links_among
from rpctl.errors import RpctlError
from rpctl.robot.collision import TOUCH_M, WORLD, CollisionModel
from rpctl.robot.model import Robot
from rpctl.robot.pair_motion import approach_rates, joint_motion, joint_travel
from rpctl.simulation.merits.collision_facts import (
    GROUND,
    SELF,
    Collision,
    CollisionFacts,
    LinkClearance,
)
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle, shape_text
from rpctl.simulation.merits.path_error import length

RESOLUTION_M = 1e-3  # m: how far a pair may move on before it is looked at again, at least
BUDGET = 100_000  # distances after which the resolution doubles: a third of a second
BLOCK = 256  # samples whose motion is added up at once
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
    """Follows the pairs along a motion.

    Args:
        around: The robot among its obstacles.
        t: Time (K,), s.
        q: Configurations (K, nq).
    """

    def __init__(self, around: Surroundings, t: Array, q: Array) -> None:
        self._around, self._t, self._q = around, t, q
        self._distances = around.model.distances()
        count, things = len(around.thing), len(around.things)
        self._thing = around.thing.tolist()
        self._pairs_of = [np.flatnonzero(around.thing == thing) for thing in range(things)]
        self._resolution, self._looks = RESOLUTION_M, 0
        self._distance = np.zeros(count)  # of each pair when it was looked at last
        self._looked = np.zeros(count)  # its path then, m
        self._looked_at = [-1] * count  # and the sample
        self._goal = np.zeros(count)  # its path at which it is to be looked at again, m
        self._least = [np.inf] * things
        self._nearest = [(0, 0)] * things  # sample and pair of the least distance
        self._touching: dict[int, tuple[float, float, float, float]] = {}
        self._instants = np.unique(np.linspace(0, len(t) - 1, INSTANTS).astype(int))
        self._series = np.full((things, len(self._instants)), np.inf)

    def run(self) -> None:
        """Follow the pairs from the first sample to the last."""
        robot, count = self._around.model.robot, len(self._around.thing)
        if not count:
            return
        rates = approach_rates(self._around.model, joint_travel(robot, self._q))
        path = np.zeros(count)
        for first in range(0, len(self._t), BLOCK):
            last = min(first + BLOCK, len(self._t))
            moved = np.cumsum(joint_motion(robot, self._q[max(first - 1, 0) : last]), axis=0)
            if not first:
                moved = np.vstack([np.zeros(rates.shape[1]), moved])
            paths = path[:, None] + rates @ moved.T  # (n, samples)
            self._follow(first, paths)
            path = paths[:, -1]

    def _follow(self, first: int, paths: Array) -> None:
        """Look at the pairs wherever they are due in some samples.

        Args:
            first: Number of the first of them.
            paths: How far each pair can have approached until then since the start (n, samples), m.
        """
        count, shown = paths.shape[1], set((self._instants - first).tolist())
        due: dict[int, int] = {}  # sample at which a pair is to be looked at
        waiting: list[list[int]] = [[] for _ in range(count)]  # pairs by that sample

        def wait(pair: int, k: int) -> None:
            due[pair] = k + int(paths[pair, k:].searchsorted(self._goal[pair]))
            if due[pair] < count:
                waiting[due[pair]].append(pair)

        for pair in np.flatnonzero(paths[:, -1] >= self._goal).tolist():
            wait(pair, 0)
        for k in range(count):
            pairs = sorted(pair for pair in waiting[k] if due[pair] == k)
            if not pairs and k not in shown:
                continue
            self._distances.place(self._q[first + k])
            for pair in pairs:
                self._look(pair, first + k, float(paths[pair, k]))
            if k in shown:
                pairs += self._show(first + k, paths[:, k])
            self._plan(pairs)
            for pair in pairs:
                wait(pair, k)

    def _look(self, pair: int, k: int, path: float) -> None:
        """Compute the distance of a pair at a sample, all shapes placed."""
        distance, thing = self._distances.distance(pair), self._thing[pair]
        self._distance[pair], self._looked[pair], self._looked_at[pair] = distance, path, k
        self._looks += 1
        if distance < self._least[thing]:
            self._least[thing], self._nearest[thing] = distance, (k, pair)
        if distance < -TOUCH_M or pair in self._touching:
            self._touch(pair, distance, float(self._t[k]))

    def _touch(self, pair: int, distance: float, t: float) -> None:
        """Keep since when and how deep a pair is in each other: depth, first, since, for how long.

        ``since`` is NaN while it is not.
        """
        depth, first, since, lasted = self._touching.get(pair, (0.0, t, np.nan, 0.0))
        lasted += 0.0 if np.isnan(since) else t - since
        if distance < -TOUCH_M:
            self._touching[pair] = max(depth, -distance), first, t, lasted
        else:
            self._touching[pair] = depth, first, np.nan, lasted

    def _plan(self, pairs: list[int]) -> None:
        """Set when to look at pairs again: when they may be nearer than their thing was, or touch.

        Args:
            pairs: Those that were just looked at.
        """
        if self._looks > BUDGET:
            self._looks, self._resolution = 0, 2.0 * self._resolution
        for pair in pairs:
            threshold = max(self._least[self._thing[pair]] - self._resolution, -TOUCH_M)
            step = max(float(self._distance[pair]) - threshold, self._resolution)
            self._goal[pair] = self._looked[pair] + step

    def _show(self, k: int, path: Array) -> list[int]:
        """Compute the distance of each thing at a sample; return the pairs that were looked at."""
        column, looked = int(np.searchsorted(self._instants, k)), list[int]()
        bound = self._distance - (path - self._looked)
        for thing, pairs in enumerate(self._pairs_of):
            least, bounds = np.inf, bound[pairs]
            while len(pairs):
                nearest = int(bounds.argmin())
                if bounds[nearest] >= least:
                    break
                pair = int(pairs[nearest])
                if self._looked_at[pair] != k:
                    self._look(pair, k, float(path[pair]))
                    looked.append(pair)
                least = min(least, float(self._distance[pair]))
                bounds[nearest] = np.inf
            self._series[thing, column] = least
        return looked

    def facts(self) -> CollisionFacts:
        """Return what was found."""
        model, end = self._around.model, float(self._t[-1])
        known = [thing for thing in range(len(self._least)) if np.isfinite(self._least[thing])]
        clearances, collisions = [], []
        for thing in known:
            k, pair = self._nearest[thing]
            names = self._names(pair)
            clearances.append(
                LinkClearance(*names[:1], float(self._least[thing]), float(self._t[k]), *names[1:])
            )
        for pair, (depth, first, since, lasted) in self._touching.items():
            lasted += 0.0 if np.isnan(since) else end - since
            collisions.append(Collision(*self._names(pair), depth, first, lasted))
        collisions = _of_links(collisions)
        return CollisionFacts(
            tuple(clearances),
            tuple(sorted(collisions, key=lambda each: -each.depth)),
            tuple((each.first, each.second, each.why) for each in model.allowed),
            model.notes,
            self._resolution,
            tuple(self._t[self._instants].tolist()),
            tuple(tuple(self._series[thing].tolist()) for thing in known),
        )

    def _names(self, pair: int) -> tuple[str, str, str]:
        """Return what a pair is with, its link, and the other link."""
        shapes = self._around.model.shapes
        first, second = (shapes[k] for k in self._around.model.pairs[pair])
        other = "" if second.joint == WORLD else second.link
        return self._around.things[self._around.thing[pair]], first.link, other
