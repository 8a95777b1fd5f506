"""Cubes that belong together: trees of parents in a column of `marks` (union and find)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled

Integers = NDArray[np.int64]


@compiled
def root(marks: Integers, parent: int, i: int) -> int:
    """Return the root of the tree of a cube, the least of its cubes, and shorten the way to it."""
    while marks[i, parent] != i:
        marks[i, parent] = marks[marks[i, parent], parent]
        i = marks[i, parent]
    return i


@compiled
def join(marks: Integers, parent: int, a: int, b: int) -> None:
    """Make one tree of those of two cubes."""
    a, b = root(marks, parent, a), root(marks, parent, b)
    if a < b:
        marks[b, parent] = a
    else:
        marks[a, parent] = b
