"""The step of the model, for all cubes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact import layout
from cube_sim.physics.contact.alone import AT_REST as CAME_TO_REST
from cube_sim.physics.contact.alone import NOTHING, step_alone
from cube_sim.physics.contact.collision import (
    collide,
    collide_with_ground,
    forget_plane,
)
from cube_sim.physics.contact.layout import (
    ACTIVES,
    ASLEEP,
    AT_REST,
    BLOCKS,
    CONTACTS,
    GROUPED,
    IMPACTS,
    LIST_A,
    LIST_B,
    MEMORY,
    ON_PLANE,
    PAIRS,
    PARTS,
    RIM,
    SPEED,
    SWEEPS,
    WHICH,
)
from cube_sim.physics.contact.motion import closing, note_motion
from cube_sim.physics.contact.neighbours import DIAGONAL, find_neighbours, list_holds
from cube_sim.physics.contact.rules import Rules, rules_of_part
from cube_sim.physics.contact.sleep import put_to_sleep
from cube_sim.physics.contact.substeps import step_in_common

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_SUBSTEPS = 1000
# A step has more parts where a pair would come nearer than a share of a side in one.
NEARER = 0.25
MOST_PARTS = 256
CUBE = 8  # row of the scratch: the state of one cube


@compiled
def parts_of_step(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    counters: Integers,
    rules: Rules,
) -> int:
    """Return into how many parts the step is cut, so that no cube jumps through another."""
    near_list = LIST_A if counters[WHICH] == 0 else LIST_B
    side = 2.0 * rules.half_side
    most = 1
    for n in range(counters[PAIRS]):
        a, b = ends[n, near_list], ends[n, near_list + 1]
        if marks[a, ASLEEP] and marks[b, ASLEEP]:
            continue
        fastest = (cubes[a, SPEED] + cubes[a, RIM]) + (cubes[b, SPEED] + cubes[b, RIM])
        if fastest * rules.time_step <= NEARER * side:
            continue
        nearer = closing(cubes, a, b) * rules.time_step
        if nearer > NEARER * side:
            x = state[0, b] - state[0, a]
            y = state[1, b] - state[1, a]
            z = state[2, b] - state[2, a]
            reach = DIAGONAL * side + nearer
            if (x * x + y * y) + z * z <= reach * reach:
                most = max(most, min(int(nearer / (NEARER * side)) + 1, MOST_PARTS))
    return most


@compiled
def advance(
    state: Floats,
    numbers: Floats,
    counters: Integers,
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    due: Floats,
    ends: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    work: Floats,
    sites: Integers,
    scratch: Floats,
    pair_capacity: int,
    count: int,
    steps: int,
) -> int:
    """
    Advance `count` cubes by up to `steps` steps; return how many were done.

    Fewer when `pair_capacity` rows of `pairs` are too few for the next step, which then has not
    begun. The arrays are those of `layout`.
    """
    whole = rules_of_part(numbers, 1)
    ground = len(marks) - 1
    cube = scratch[CUBE]
    for done in range(steps):
        parts = 1
        if whole.collide > 0.0:
            if not list_holds(state, cubes, marks, counters, whole, count) and not find_neighbours(
                state, cubes, marks, ends, sites, counters, whole, count, pair_capacity
            ):
                return done
            note_motion(state, cubes, marks, whole.half_side, count)
            parts = parts_of_step(state, cubes, marks, ends, counters, whole)
        counters[PARTS] = parts
        counters[SWEEPS] = 0
        counters[IMPACTS] = 0
        counters[ACTIVES] = 0
        rules = rules_of_part(numbers, parts)
        for part in range(parts):
            counters[BLOCKS] = 0
            if whole.collide > 0.0:
                # Within the step impacts may have sped cubes up. Should there be no room for
                # more neighbours now, the list of before serves to the end of the step.
                if part > 0 and not list_holds(state, cubes, marks, counters, rules, count):
                    find_neighbours(
                        state, cubes, marks, ends, sites, counters, rules, count, pair_capacity
                    )
                if part > 0:
                    note_motion(state, cubes, marks, rules.half_side, count)
                collide(cubes, marks, pairs, due, ends, counters, scratch, rules, count)
                if counters[ACTIVES] > 0:
                    ratio = rules.time_step / rules.substep
                    substeps = min(int(ratio) + (int(ratio) < ratio), MOST_SUBSTEPS)
                    time = rules.time_step / substeps
                    last_time = scratch[MEMORY, 0] if scratch[MEMORY, 0] > 0.0 else time
                    scratch[MEMORY, 0] = time
                    collide_with_ground(
                        cubes,
                        marks,
                        pairs,
                        ends,
                        counters,
                        rules,
                        count,
                        pair_capacity,
                        ground,
                        last_time,
                    )
                    step_in_common(
                        state,
                        cubes,
                        marks,
                        pairs,
                        ends,
                        bodies,
                        blocks,
                        lanes,
                        work,
                        counters,
                        rules,
                        count,
                        substeps,
                        ground,
                        last_time,
                    )
            for i in range(count):
                if (
                    marks[i, ASLEEP]
                    or marks[i, AT_REST]
                    or (whole.collide > 0.0 and marks[i, GROUPED])
                ):
                    continue
                for n in range(13):
                    cube[n] = state[n, i]
                result = step_alone(cube, cubes[i], rules, scratch)
                for n in range(13):
                    state[n, i] = cube[n]
                marks[i, AT_REST] = 1 if result == CAME_TO_REST else 0
                if result != NOTHING:
                    marks[i, ON_PLANE] = 1
                elif marks[i, ON_PLANE]:
                    forget_plane(cubes, marks, i)
                counters[CONTACTS] += result != NOTHING
        # For each pair that touches, and each cube that rests.
        counters[CONTACTS] += counters[ACTIVES]
        for i in range(count):
            if marks[i, ASLEEP] or marks[i, AT_REST]:
                counters[CONTACTS] += 1
        if whole.sleep > 0.0:
            put_to_sleep(state, cubes, marks, pairs, ends, counters, whole, count, ground)
    return steps


def entry(types: Any, carray: Any) -> tuple[Any, Any]:
    """Return the signature and the function of the machine code (machine_code.CONTACT)."""
    floats, integers = types.CPointer(types.float64), types.CPointer(types.int64)
    integer = types.int64
    numbers_count = len(Rules._fields)
    rows, cube_columns, mark_columns = 13, layout.CUBE_COLUMNS, layout.MARK_COLUMNS
    pair_columns, end_columns = layout.PAIR_COLUMNS, layout.END_COLUMNS
    body_columns, block_size = layout.BODY_COLUMNS, layout.BLOCK_SIZE
    lane_columns, work_size = layout.LANE_COLUMNS, layout.WORK_SIZE
    counters_count = layout.COUNTERS
    scratch_shape = (layout.SCRATCH_ROWS, layout.SCRATCH_COLUMNS)

    def call(  # type: ignore[no-untyped-def]
        state,
        numbers,
        counters,
        cubes,
        marks,
        pairs,
        due,
        ends,
        bodies,
        blocks,
        lanes,
        work,
        sites,
        scratch,
        capacity,
        pair_capacity,
        block_capacity,
        site_capacity,
        count,
        steps,
    ):
        return advance(
            carray(state, (rows, capacity)),
            carray(numbers, numbers_count),
            carray(counters, counters_count),
            carray(cubes, (capacity + 1, cube_columns)),
            carray(marks, (capacity + 1, mark_columns)),
            carray(pairs, (pair_capacity + capacity, pair_columns)),
            carray(due, pair_capacity + capacity),
            carray(ends, (pair_capacity + capacity, end_columns)),
            carray(bodies, (capacity + 1, body_columns)),
            carray(blocks, (block_capacity, block_size)),
            carray(lanes, (block_capacity, lane_columns)),
            carray(work, work_size),
            carray(sites, site_capacity),
            carray(scratch, scratch_shape),
            pair_capacity,
            count,
            steps,
        )

    arrays = (
        *(floats, floats, integers, floats, integers, floats, floats, integers),
        *(floats, floats, integers, floats, integers, floats),
    )
    return integer(*arrays, *[integer] * 6), call
