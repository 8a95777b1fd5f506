"""How cubes move, as the search for contacts needs to know it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.layout import (
    ASLEEP,
    AT_REST,
    GONE,
    POSE,
    RIM,
    SPEED,
    VELOCITY,
)
from cube_sim.physics.contact.neighbours import DIAGONAL

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@compiled
def note_motion(
    state: Floats, cubes: Floats, marks: Integers, half_side: float, count: int
) -> None:
    """Bring up to date where each cube is, and how fast and how far it goes."""
    for i in range(count):
        # What sleeps or rests has been noted as it is.
        if not marks[i, ASLEEP] and not marks[i, AT_REST]:
            note_cube(state, cubes, i, half_side)


@compiled
def note_cube(state: Floats, cubes: Floats, i: int, half_side: float) -> None:
    """Do so for one."""
    cube, reach = cubes[i], half_side * DIAGONAL
    way, turn, speed, spin = 0.0, 0.0, 0.0, 0.0
    for n in range(3):
        d = state[n, i] - cube[POSE + n]
        way += d * d
    for n in range(3, 7):
        d = state[n, i] - cube[POSE + n]
        turn += d * d
    for n in range(7):
        cube[POSE + n] = state[n, i]
    # An angle is at most 2.23 times as large as the difference of the unit quaternions.
    cube[GONE] += math.sqrt(way) + 2.23 * math.sqrt(turn) * reach
    for n in range(3):
        cube[VELOCITY + n] = state[7 + n, i]
        speed += state[7 + n, i] * state[7 + n, i]
        spin += state[10 + n, i] * state[10 + n, i]
    cube[SPEED] = math.sqrt(speed)
    cube[RIM] = math.sqrt(spin) * reach


@compiled
def closing(cubes: Floats, a: int, b: int) -> float:
    """Return a bound of the speed at which two points of two cubes may approach, m/s."""
    x = cubes[b, VELOCITY] - cubes[a, VELOCITY]
    y = cubes[b, VELOCITY + 1] - cubes[a, VELOCITY + 1]
    z = cubes[b, VELOCITY + 2] - cubes[a, VELOCITY + 2]
    rims: float = cubes[a, RIM] + cubes[b, RIM]
    return math.sqrt((x * x + y * y) + z * z) + rims
