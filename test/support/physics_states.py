"""Cubes to throw: the same on every machine and with every version of numpy."""

from __future__ import annotations

import math
import random

import numpy as np

from cube_sim.physics import Settings, World


class Draw:
    """Numbers from a seed; Python promises that `random()` never changes."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def number(self, low: float, high: float) -> float:
        return low + (high - low) * self._random.random()

    def vector(self, low: float, high: float, length: int = 3) -> list[float]:
        return [self.number(low, high) for _ in range(length)]

    def orientation(self) -> list[float]:
        """A unit quaternion, x y z w, from the ball."""
        while True:
            q = self.vector(-1.0, 1.0, 4)
            # Not by sum(), which rounds otherwise from Python 3.12 on.
            x, y, z, w = q
            length = math.sqrt(((x * x + y * y) + z * z) + w * w)
            if 0.1 < length <= 1.0:
                return [x / length for x in q]


def crowd(count: int, seed: int = 1) -> list[tuple[list[float], ...]]:
    """Throws (position, orientation, velocity, spin) that soon are in contact in many ways."""
    draw = Draw(seed)
    throws = []
    for index in range(count):
        position = [draw.number(-5.0, 5.0), draw.number(-5.0, 5.0), draw.number(0.0, 2.0)]
        # One in eight lies flat, one in eight turns by far more than a quarter turn a step.
        orientation = [0.0, 0.0, 0.0, 1.0] if index % 8 == 3 else draw.orientation()
        spin = draw.vector(-10.0, 10.0)
        if index % 8 == 3:
            spin = [0.0, 0.0, 0.0]
        elif index % 8 == 5:
            spin = [1000.0 * x for x in spin]
        throws.append((position, orientation, draw.vector(-6.0, 6.0), spin))
    return throws


def thrown(settings: Settings, throws: list[tuple[list[float], ...]], *, threads: int = 1) -> World:
    """A world with these throws in it."""
    world = World(settings, threads=threads)
    world.throw(*(np.array(column) for column in zip(*throws, strict=True)))
    return world
