"""What advances a world: the one interface between a World and a physics model."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.settings import Settings

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class ContactPoints(NamedTuple):
    """
    Where cubes touched in the last step, K points.

    `positions` (K, 3), m, world; `normals` (K, 3), unit vectors that point at the first cube;
    `impulses` (K, 3), N s, what the first cube got there in the step; `cubes` (K, 2), the indices
    of the two cubes, the second -1 for the plane.
    """

    positions: Floats
    normals: Floats
    impulses: Floats
    cubes: Integers


NO_CONTACT_POINTS = ContactPoints(
    np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2), np.int64)
)


class Engine(Protocol):
    """
    Advances the cubes of a world by one model.

    It works on the memory and by the settings that `use` gave it last, and may remember what
    went before (contacts, sleep), as a function of the calls alone.
    """

    def use(self, state: Floats, settings: Settings) -> None:
        """Work on `state` (13, capacity) by `settings` from now on."""

    def added(self, first: int, count: int) -> None:
        """Take note that the cubes `first` to `count` - 1 are new."""

    def cleared(self) -> None:
        """Take note that all cubes are gone."""

    def advance(self, count: int, steps: int) -> int:
        """Advance `count` cubes by `steps` steps; return how many contacts they had."""

    def awake(self, count: int) -> int:
        """Return how many of `count` cubes are not asleep."""

    def contact_points(self, count: int) -> ContactPoints:
        """Return where the cubes touched in the last step, as far as the model knows."""

    def counters(self) -> dict[str, int]:
        """Return what the last step took, by name: numbers for diagnostics."""
