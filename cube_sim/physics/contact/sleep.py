"""Sleep: islands of touching cubes that have been still for a while are left as they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.forest import join, root
from cube_sim.physics.contact.layout import (
    ACTIVE,
    ACTIVES,
    ASLEEP,
    AT_REST,
    GROUPED,
    ISLAND,
    LEAST,
    PUSH,
    RESTS,
    STILL,
)
from cube_sim.physics.contact.motion import note_cube
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.contact.solver import SLOP

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# In touching distances: an overlap this deep is still being pushed apart.
DEEP = 5.0


@compiled
def is_pushed_by_plane(cubes: Floats, i: int) -> bool:
    """Say whether the plane has pushed a corner of a cube in the last step."""
    pushed = 0.0
    for k in range(8):
        pushed += cubes[i, PUSH + 3 * k + 2]
    return pushed > 0.0


@compiled
def note_rest(marks: Integers, i: int, rests: int) -> None:
    """Note of the island of a cube that it rests on something (1), or overlaps (-1), for good."""
    if marks[i, ASLEEP]:
        return
    name = root(marks, ISLAND, i)
    marks[name, RESTS] = -1 if rests < 0 or marks[name, RESTS] < 0 else 1


@compiled
def put_to_sleep(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    counters: Integers,
    rules: Rules,
    count: int,
    ground: int,
) -> None:
    """
    Count the still time of all cubes and put to sleep the islands whose time has come.

    An island sleeps when all its cubes have been slower than `rules.sleep_speed`, on account of
    the spin as well, for `rules.sleep_delay`, if it rests on the plane or on sleepers and no two of
    it overlap by more than is left alone when they are pushed apart.
    """
    tired = False
    limit = rules.sleep_speed * rules.sleep_speed
    for i in range(count):
        if marks[i, ASLEEP]:
            continue
        v = (state[7, i] * state[7, i] + state[8, i] * state[8, i]) + state[9, i] * state[9, i]
        w = (state[10, i] * state[10, i] + state[11, i] * state[11, i]) + (
            state[12, i] * state[12, i]
        )
        # Who is alone on the plane comes to an exact rest; only a group may be cut short.
        still = v + w * rules.half_side * rules.half_side <= limit
        if still and (marks[i, GROUPED] or marks[i, AT_REST]):
            cubes[i, STILL] += rules.time_step
            tired = tired or cubes[i, STILL] >= rules.sleep_delay
        else:
            cubes[i, STILL] = 0.0
    if not tired:
        return
    for i in range(count):
        if not marks[i, ASLEEP]:
            marks[i, ISLAND] = i
            # Who is alone on the plane comes to an exact rest only there.
            marks[i, RESTS] = 1 if marks[i, AT_REST] else 0
    # A load rests at a gap of up to the slop: with that as the limit, an island would fall apart
    # and its parts, waking each other in turn, never sleep.
    touching = 2.0 * SLOP * 2.0 * rules.half_side
    for n in range(counters[ACTIVES]):
        number, a, b = ends[n, ACTIVE], ends[n, ACTIVE + 1], ends[n, ACTIVE + 2]
        if a == ground or marks[a, ASLEEP] or marks[b, ASLEEP]:
            continue
        if pairs[number, LEAST] <= touching:
            join(marks, ISLAND, a, b)
    for n in range(counters[ACTIVES]):
        number, a, b = ends[n, ACTIVE], ends[n, ACTIVE + 1], ends[n, ACTIVE + 2]
        if a == ground:
            if is_pushed_by_plane(cubes, b):
                note_rest(marks, b, 1)
        elif pairs[number, LEAST] < -DEEP * touching:
            note_rest(marks, a, -1)
            note_rest(marks, b, -1)
        elif pairs[number, LEAST] <= touching and marks[a, ASLEEP] != marks[b, ASLEEP]:
            note_rest(marks, a if marks[b, ASLEEP] else b, 1)
    # An island takes the shortest still time of its cubes.
    for i in range(count):
        if not marks[i, ASLEEP]:
            name = root(marks, ISLAND, i)
            cubes[name, STILL] = min(cubes[name, STILL], cubes[i, STILL])
    for i in range(count):
        if not marks[i, ASLEEP] and root(marks, ISLAND, i) != i:
            marks[i, ISLAND] = root(marks, ISLAND, i)
    for i in range(count):
        rests = marks[marks[i, ISLAND], RESTS] > 0
        if not marks[i, ASLEEP] and rests and cubes[marks[i, ISLAND], STILL] >= rules.sleep_delay:
            marks[i, ASLEEP] = 1
            for n in range(7, 13):
                state[n, i] = 0.0
            note_cube(state, cubes, i, rules.half_side)
