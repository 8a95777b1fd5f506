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
    STILL,
)
from cube_sim.physics.contact.motion import note_cube
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.contact.solver import SLOP

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


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
    the spin as well, for `rules.sleep_delay`.
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
    # A load rests at a gap of up to the slop: with that as the limit, an island would fall apart
    # and its parts, waking each other in turn, never sleep.
    touching = 2.0 * SLOP * 2.0 * rules.half_side
    for n in range(counters[ACTIVES]):
        number, a, b = ends[n, ACTIVE], ends[n, ACTIVE + 1], ends[n, ACTIVE + 2]
        if a == ground or marks[a, ASLEEP] or marks[b, ASLEEP]:
            continue
        if pairs[number, LEAST] <= touching:
            join(marks, ISLAND, a, b)
    # An island takes the shortest still time of its cubes.
    for i in range(count):
        if not marks[i, ASLEEP]:
            name = root(marks, ISLAND, i)
            cubes[name, STILL] = min(cubes[name, STILL], cubes[i, STILL])
    for i in range(count):
        if not marks[i, ASLEEP] and root(marks, ISLAND, i) != i:
            marks[i, ISLAND] = root(marks, ISLAND, i)
    for i in range(count):
        if not marks[i, ASLEEP] and cubes[marks[i, ISLAND], STILL] >= rules.sleep_delay:
            marks[i, ASLEEP] = 1
            for n in range(7, 13):
                state[n, i] = 0.0
            note_cube(state, cubes, i, rules.half_side)
