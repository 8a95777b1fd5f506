"""The separating axis of two cubes: fifteen directions, of which the one with the widest gap."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.layout import MATRIX, POSE

Floats = NDArray[np.float64]

# Columns of the relative place: where the axes of the second lie in those of the first
# (C[i, j] = a_i.b_j), and the way between the centres in either, m.
COSINES, IN_A, IN_B = 0, 9, 12

# In half sides: by how much a gap must be wider to be preferred to that of a face; to that of
# the axis of the last step.
EDGE_HANDICAP, HABIT = 4e-3, 2e-3
NO_AXIS = -1
FIRST_EDGE = 6


@compiled
def relate(cubes: Floats, a: int, b: int, place: Floats) -> None:
    """Fill the relative place of the cubes a and b."""
    dx = cubes[b, POSE] - cubes[a, POSE]
    dy = cubes[b, POSE + 1] - cubes[a, POSE + 1]
    dz = cubes[b, POSE + 2] - cubes[a, POSE + 2]
    for i in range(3):
        ax = cubes[a, MATRIX + i]
        ay = cubes[a, MATRIX + 3 + i]
        az = cubes[a, MATRIX + 6 + i]
        place[IN_A + i] = (ax * dx + ay * dy) + az * dz
        for j in range(3):
            place[COSINES + 3 * i + j] = (
                ax * cubes[b, MATRIX + j] + ay * cubes[b, MATRIX + 3 + j]
            ) + az * cubes[b, MATRIX + 6 + j]
    for j in range(3):
        place[IN_B + j] = (cubes[b, MATRIX + j] * dx + cubes[b, MATRIX + 3 + j] * dy) + cubes[
            b, MATRIX + 6 + j
        ] * dz


@compiled
def widest_axis(place: Floats, half_side: float, margin: float, habit: int) -> tuple[int, float]:
    """
    Return the axis with the widest gap, and the gap, m; NO_AXIS when it is above `margin`.

    Axes 0 to 2 are the faces of the first cube, 3 to 5 those of the second, 6 + 3 i + j the
    edge i of the first across the edge j of the second. `habit` is the axis of the last step.
    """
    best_axis, best_gap, best_score = NO_AXIS, -1e300, -1e300
    for axis in range(6):
        if axis < 3:
            spread = (abs(place[3 * axis]) + abs(place[3 * axis + 1])) + abs(place[3 * axis + 2])
            gap = abs(place[IN_A + axis]) - half_side * (1.0 + spread)
        else:
            j = axis - 3
            spread = (abs(place[j]) + abs(place[3 + j])) + abs(place[6 + j])
            gap = abs(place[IN_B + j]) - half_side * (1.0 + spread)
        score = gap + HABIT * half_side if axis == habit else gap
        if score > best_score:
            best_axis, best_gap, best_score = axis, gap, score
    if best_gap > margin:
        return NO_AXIS, best_gap
    # By how much an edge may be preferred on top of its gap, where that is negative.
    least = (HABIT - EDGE_HANDICAP) * half_side
    for i in range(3):
        i1 = (i + 1) % 3
        i2 = (i + 2) % 3
        for j in range(3):
            cosine = place[3 * i + j]
            square = 1.0 - cosine * cosine
            # Edges that are nearly parallel lie in planes that the faces have tested.
            if square > 1e-4:
                j1 = (j + 1) % 3
                j2 = (j + 2) % 3
                spread = (abs(place[3 * i1 + j]) + abs(place[3 * i2 + j])) + (
                    abs(place[3 * i + j1]) + abs(place[3 * i + j2])
                )
                way = abs(
                    place[IN_A + i2] * place[3 * i1 + j] - place[IN_A + i1] * place[3 * i2 + j]
                )
                gap = way - half_side * spread
                # What is negative grows in size by the division: no need to do it then.
                if gap + least <= best_score:
                    continue
                gap /= math.sqrt(square)
                if gap > margin:
                    return NO_AXIS, gap
                axis = FIRST_EDGE + 3 * i + j
                score = gap - EDGE_HANDICAP * half_side
                if axis == habit:
                    score += HABIT * half_side
                if score > best_score:
                    best_axis, best_gap, best_score = axis, gap, score
    return best_axis, best_gap
