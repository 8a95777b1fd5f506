"""Which cubes may touch: a grid of cells, and a list that stays good while nobody goes far."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.layout import (
    ASLEEP,
    CELL,
    FREE,
    FREES,
    HOME,
    LIST_A,
    LIST_B,
    NEXT,
    PAIRS,
    POINTS,
    REACH,
    REBUILDS,
    ROWS_USED,
    SEEN,
    STALE,
    WHICH,
)
from cube_sim.physics.contact.rules import Rules

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DIAGONAL = 1.7320508075688774
# A list of neighbours is to hold for so many steps; a slow cube may go so far at least, in sides.
STEPS, SKIN = 16.0, 0.1
# Who goes farther in that time, in sides and as a multiple of the mean, is a fast one.
FAST, FASTER = 0.3, 3.0
# In sides: cubes this near may touch in any case.
NEAR = 0.04


@compiled
def floor(x: float) -> int:
    """Return the greatest whole number that is not above x."""
    whole = int(x)
    return whole - 1 if x < whole else whole


@compiled
def travel(state: Floats, i: int, rules: Rules) -> float:
    """Return how far the centre of a cube may get in this step, m."""
    v = (state[7, i] * state[7, i] + state[8, i] * state[8, i]) + state[9, i] * state[9, i]
    return (math.sqrt(v) + rules.gravity * rules.time_step) * rules.time_step


@compiled
def list_holds(
    state: Floats, cubes: Floats, marks: Integers, counters: Integers, rules: Rules, count: int
) -> bool:
    """Say whether the list of neighbours is good for another step."""
    if counters[STALE]:
        return False
    for i in range(count):
        if not marks[i, ASLEEP]:
            x = state[0, i] - cubes[i, HOME]
            y = state[1, i] - cubes[i, HOME + 1]
            z = state[2, i] - cubes[i, HOME + 2]
            gone = math.sqrt((x * x + y * y) + z * z)
            if gone + travel(state, i, rules) > cubes[i, REACH]:
                return False
    return True


@compiled
def bucket(x: int, y: int, z: int, mask: int) -> int:
    """Return the bucket of a cell."""
    return ((x * 73856093) ^ (y * 19349663) ^ (z * 83492791)) & mask


@compiled
def may_meet(cubes: Floats, i: int, j: int, near: float) -> bool:
    """Say whether two cubes may come within `near` of each other before the next search."""
    x = cubes[j, HOME] - cubes[i, HOME]
    y = cubes[j, HOME + 1] - cubes[i, HOME + 1]
    z = cubes[j, HOME + 2] - cubes[i, HOME + 2]
    reach = near + cubes[i, REACH] + cubes[j, REACH]
    return bool((x * x + y * y) + z * z <= reach * reach)


@compiled
def find_neighbours(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    sites: Integers,
    counters: Integers,
    rules: Rules,
    count: int,
    pair_capacity: int,
) -> bool:
    """
    Write the list of all pairs that may touch in the next steps, ordered; False if it is too long.

    A pair that was in the list before keeps its row of `pairs`. Cubes that go far in a step are
    compared with all others.
    """
    # Should the list get too long, the one of before no longer holds: homes have changed.
    counters[STALE] = 1
    side = 2.0 * rules.half_side
    total = 0.0
    for i in range(count):
        step = travel(state, i, rules)
        total += step
        for n in range(3):
            cubes[i, HOME + n] = state[n, i]
        cubes[i, REACH] = max(SKIN * side, STEPS * step)
    limit = max(FAST * side, FASTER * STEPS * (total / count))
    farthest = 0.0
    for i in range(count):
        if cubes[i, REACH] <= limit:
            farthest = max(farthest, cubes[i, REACH])
    near = side * (DIAGONAL + NEAR)
    per_cell = 1.0 / (near + 2.0 * farthest)
    mask = len(sites) // 2 - 1
    for n in range(mask + 1):
        sites[n] = -1
    fast = 0  # a list of the fast ones, in the second half of `sites`
    for i in range(count):
        if cubes[i, REACH] > limit:
            marks[i, NEXT] = -2
            sites[mask + 1 + fast] = i
            fast += 1
        else:
            x = floor(state[0, i] * per_cell)
            y = floor(state[1, i] * per_cell)
            z = floor(state[2, i] * per_cell)
            marks[i, CELL] = x
            marks[i, CELL + 1] = y
            marks[i, CELL + 2] = z
            # The later a cube, the nearer to the head of the chain of its bucket.
            place = bucket(x, y, z, mask)
            marks[i, NEXT] = sites[place]
            sites[place] = i

    old = LIST_A if counters[WHICH] == 0 else LIST_B
    new = LIST_B if counters[WHICH] == 0 else LIST_A
    pairs = 0
    for i in range(count):
        first = pairs
        if pairs + count >= pair_capacity and pairs + 1024 >= pair_capacity:
            return False
        if marks[i, NEXT] == -2:
            for j in range(i + 1, count):
                if may_meet(cubes, i, j, near):
                    if pairs >= pair_capacity:
                        return False
                    ends[pairs, new] = i
                    ends[pairs, new + 1] = j
                    pairs += 1
            continue
        for n in range(fast):
            j = sites[mask + 1 + n]
            if j > i and may_meet(cubes, i, j, near):
                if pairs >= pair_capacity:
                    return False
                ends[pairs, new] = i
                ends[pairs, new + 1] = j
                pairs += 1
        cx, cy, cz = marks[i, CELL], marks[i, CELL + 1], marks[i, CELL + 2]
        for x in range(cx - 1, cx + 2):
            for y in range(cy - 1, cy + 2):
                for z in range(cz - 1, cz + 2):
                    j = sites[bucket(x, y, z, mask)]
                    while j > i:
                        if (
                            may_meet(cubes, i, j, near)
                            and marks[j, CELL] == x
                            and marks[j, CELL + 1] == y
                            and marks[j, CELL + 2] == z
                        ):
                            if pairs >= pair_capacity:
                                return False
                            ends[pairs, new] = i
                            ends[pairs, new + 1] = j
                            pairs += 1
                        j = marks[j, NEXT]
        for n in range(first + 1, pairs):
            j = ends[n, new + 1]
            m = n - 1
            while m >= first and ends[m, new + 1] > j:
                ends[m + 1, new + 1] = ends[m, new + 1]
                m -= 1
            ends[m + 1, new + 1] = j

    # Both lists are ordered: one pass finds what stays and frees the rows of the others.
    frees = counters[FREES]
    n = 0
    for m in range(counters[PAIRS]):
        i, j = ends[m, old], ends[m, old + 1]
        while n < pairs and (ends[n, new] < i or (ends[n, new] == i and ends[n, new + 1] < j)):
            ends[n, new + 2] = -1
            n += 1
        if n < pairs and ends[n, new] == i and ends[n, new + 1] == j:
            ends[n, new + 2] = ends[m, old + 2]
            n += 1
        else:
            ends[frees, FREE] = ends[m, old + 2]
            frees += 1
    while n < pairs:
        ends[n, new + 2] = -1
        n += 1
    for m in range(pairs):
        if ends[m, new + 2] < 0:
            if frees > 0:
                frees -= 1
                row = ends[frees, FREE]
            else:
                row = counters[ROWS_USED]
                counters[ROWS_USED] += 1
            ends[m, new + 2] = row
            ends[row, POINTS] = 0
            ends[row, SEEN] = -1
    counters[FREES] = frees
    counters[PAIRS] = pairs
    counters[WHICH] = 1 - counters[WHICH]
    counters[STALE] = 0
    counters[REBUILDS] += 1
    return True
