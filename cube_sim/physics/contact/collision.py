"""The collision phase: which cubes touch now, where, and who is woken by it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.axes import FIRST_EDGE, NO_AXIS, relate, widest_axis
from cube_sim.physics.contact.layout import (
    ACTIVE,
    ACTIVES,
    ARM_A,
    ARM_B,
    ASLEEP,
    AT_REST,
    AXIS,
    BUILT,
    FORCE,
    GAP,
    GROUPED,
    IMPULSE_N,
    INVERSE_INERTIA,
    INVERSE_MASS,
    ISLAND,
    LIST_A,
    LIST_B,
    LOCAL_A,
    LOCAL_B,
    LOCAL_NORMAL,
    MASS_N,
    MASS_T,
    MATRIX,
    NORMAL,
    PAIRS,
    PHASE,
    PLACE,
    POINT,
    POINT_COLUMNS,
    POINTS,
    PUSH,
    SEEN,
    SHIFT,
    STAMP,
    STILL,
    SV,
    SW,
    TOTAL,
    TOUCHED,
    WHICH,
)
from cube_sim.physics.contact.manifold import (
    edge_point,
    face_points,
    recall_impulses,
    remember_points,
)
from cube_sim.physics.contact.neighbours import DIAGONAL
from cube_sim.physics.contact.rules import Rules

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# In sides: overlap that is left alone, so that what touches keeps touching.
SLOP = 4e-5
# In sides: cubes nearer than this are solved in common, whatever their speeds.
MARGIN = 0.01
# In sides and radians: cubes that moved less against each other keep their points.
UNCHANGED = 2e-4
RELATIVE = 20  # row of the scratch: the relative place of two cubes


@compiled
def take_up(state: Floats, cubes: Floats, marks: Integers, i: int, phase: int) -> None:
    """Write place and rotation matrix of a cube to its row, once in a collision phase."""
    if marks[i, STAMP] == phase:
        return
    marks[i, STAMP] = phase
    for n in range(3):
        cubes[i, PLACE + n] = state[n, i]
    x, y, z, w = state[3, i], state[4, i], state[5, i], state[6, i]
    cubes[i, MATRIX] = 1.0 - 2.0 * (y * y + z * z)
    cubes[i, MATRIX + 1] = 2.0 * (x * y - z * w)
    cubes[i, MATRIX + 2] = 2.0 * (x * z + y * w)
    cubes[i, MATRIX + 3] = 2.0 * (x * y + z * w)
    cubes[i, MATRIX + 4] = 1.0 - 2.0 * (x * x + z * z)
    cubes[i, MATRIX + 5] = 2.0 * (y * z - x * w)
    cubes[i, MATRIX + 6] = 2.0 * (x * z - y * w)
    cubes[i, MATRIX + 7] = 2.0 * (y * z + x * w)
    cubes[i, MATRIX + 8] = 1.0 - 2.0 * (x * x + y * y)


@compiled
def closing(state: Floats, a: int, b: int, half_side: float) -> float:
    """Return a bound of the speed at which two points of two cubes may approach, m/s."""
    x = state[7, b] - state[7, a]
    y = state[8, b] - state[8, a]
    z = state[9, b] - state[9, a]
    speed = math.sqrt((x * x + y * y) + z * z)
    for i in (a, b):
        x, y, z = state[10, i], state[11, i], state[12, i]
        speed += math.sqrt((x * x + y * y) + z * z) * half_side * DIAGONAL
    return speed


@compiled
def wake(marks: Integers, cubes: Floats, i: int, count: int) -> None:
    """Wake the island of a sleeping cube."""
    island = marks[i, ISLAND]
    for n in range(count):
        if marks[n, ASLEEP] and marks[n, ISLAND] == island:
            marks[n, ASLEEP] = 0
            marks[n, AT_REST] = 0
            cubes[n, STILL] = 0.0


@compiled
def collide(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    counters: Integers,
    scratch: Floats,
    rules: Rules,
    count: int,
) -> None:
    """Find the points of all pairs that touch or may in this step; list these as ACTIVE."""
    counters[PHASE] += 1
    phase = counters[PHASE]
    near_list = LIST_A if counters[WHICH] == 0 else LIST_B
    half_side = rules.half_side
    side = 2.0 * half_side
    for i in range(count):
        marks[i, GROUPED] = 0
    # A touch wakes an island, whose own pairs then count: again, until no one wakes.
    woken = True
    while woken:
        woken = False
        for n in range(counters[PAIRS]):
            a, b, row = ends[n, near_list], ends[n, near_list + 1], ends[n, near_list + 2]
            if ends[row, SEEN] == phase or (marks[a, ASLEEP] and marks[b, ASLEEP]):
                continue
            ends[row, SEEN] = phase
            speed = closing(state, a, b, half_side)
            margin = MARGIN * side + (speed + rules.gravity * rules.time_step) * rules.time_step
            x = state[0, b] - state[0, a]
            y = state[1, b] - state[1, a]
            z = state[2, b] - state[2, a]
            reach = DIAGONAL * side + margin
            points = 0
            if (x * x + y * y) + z * z <= reach * reach:
                take_up(state, cubes, marks, a, phase)
                take_up(state, cubes, marks, b, phase)
                points = touch(cubes, pairs, ends, scratch, a, b, row, half_side, margin)
            ends[row, POINTS] = points
            if points == 0:
                continue
            if marks[a, ASLEEP] or marks[b, ASLEEP]:
                for p in range(points):
                    gap = pairs[row, POINT + p * POINT_COLUMNS + GAP]
                    if gap <= SLOP * side + speed * rules.time_step:
                        woken = True
                if woken:
                    wake(marks, cubes, a if marks[a, ASLEEP] else b, count)
            marks[a, GROUPED] = 1
            marks[b, GROUPED] = 1
    # In the order of the list, whoever woke when.
    active = 0
    for n in range(counters[PAIRS]):
        a, b, row = ends[n, near_list], ends[n, near_list + 1], ends[n, near_list + 2]
        if ends[row, SEEN] == phase and ends[row, POINTS] > 0:
            ends[active, ACTIVE] = row
            ends[active, ACTIVE + 1] = a
            ends[active, ACTIVE + 2] = b
            active += 1
    counters[ACTIVES] = active


@compiled
def touch(
    cubes: Floats,
    pairs: Floats,
    ends: Integers,
    scratch: Floats,
    a: int,
    b: int,
    number: int,
    half_side: float,
    margin: float,
) -> int:
    """Fill the row of a pair with its points and return their number."""
    row, place = pairs[number], scratch[RELATIVE]
    relate(cubes, a, b, place)
    points: int = ends[number, POINTS]
    moved = 1e300 if points == 0 else 0.0
    for n in range(12):
        scale = 1.0 if n < 9 else 1.0 / half_side
        moved = max(moved, abs(place[n] - row[BUILT + n]) * scale)
    kept = moved < UNCHANGED and points > 0
    if not kept:
        habit = ends[number, AXIS] if points > 0 else NO_AXIS
        axis, gap = widest_axis(place, half_side, margin, habit)
        if axis == NO_AXIS:
            return 0
        remember_points(row, points, scratch)
        last = points
        if axis < FIRST_EDGE:
            points = face_points(place, axis, half_side, margin, row, scratch)
        else:
            points = edge_point(place, axis, half_side, gap, row)
        recall_impulses(row, points, last, half_side, scratch)
        ends[number, AXIS] = axis
        for n in range(12):
            row[BUILT + n] = place[n]
    for i in range(3):
        row[NORMAL + i] = (
            cubes[a, MATRIX + 3 * i] * row[LOCAL_NORMAL]
            + cubes[a, MATRIX + 3 * i + 1] * row[LOCAL_NORMAL + 1]
        ) + cubes[a, MATRIX + 3 * i + 2] * row[LOCAL_NORMAL + 2]
    for p in range(points):
        at = POINT + p * POINT_COLUMNS
        gap = 0.0
        for i in range(3):
            m = MATRIX + 3 * i
            on_a = (
                cubes[a, m] * row[at + LOCAL_A] + cubes[a, m + 1] * row[at + LOCAL_A + 1]
            ) + cubes[a, m + 2] * row[at + LOCAL_A + 2]
            on_b = (
                cubes[b, m] * row[at + LOCAL_B] + cubes[b, m + 1] * row[at + LOCAL_B + 1]
            ) + cubes[b, m + 2] * row[at + LOCAL_B + 2]
            way = cubes[b, PLACE + i] - cubes[a, PLACE + i]
            gap += row[NORMAL + i] * ((way + on_b) - on_a)
            # One point for both, or an impulse would turn the two as a whole.
            row[at + ARM_A + i] = 0.5 * ((way + on_b) + on_a)
            row[at + ARM_B + i] = row[at + ARM_A + i] - way
        row[at + GAP] = gap
    return points


@compiled
def stand_on_ground(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    scratch: Floats,
    rules: Rules,
    i: int,
    row_number: int,
    phase: int,
) -> int:
    """Fill the row of a cube and the ground, at most its four lowest corners; return how many."""
    take_up(state, cubes, marks, i, phase)
    h = rules.half_side
    speed = (abs(state[7, i]) + abs(state[8, i])) + abs(state[9, i])
    speed += ((abs(state[10, i]) + abs(state[11, i])) + abs(state[12, i])) * h * DIAGONAL
    margin = 2.0 * MARGIN * h + (speed + rules.gravity * rules.time_step) * rules.time_step
    for n in range(24):
        cubes[i, PUSH + n] = 0.0
    if state[2, i] - h * DIAGONAL > margin:
        return 0
    row = pairs[row_number]
    row[NORMAL] = 0.0
    row[NORMAL + 1] = 0.0
    row[NORMAL + 2] = 1.0
    points = 0
    for k in range(8):
        x = h if k & 1 else -h
        y = h if k & 2 else -h
        z = h if k & 4 else -h
        rz = (cubes[i, MATRIX + 6] * x + cubes[i, MATRIX + 7] * y) + cubes[i, MATRIX + 8] * z
        gap = state[2, i] + rz
        if gap >= margin:
            continue
        # A fifth one takes the place of the highest.
        slot = points
        if points == 4:
            slot, highest = -1, gap
            for p in range(4):
                if pairs[row_number, POINT + p * POINT_COLUMNS + GAP] > highest:
                    highest = pairs[row_number, POINT + p * POINT_COLUMNS + GAP]
                    slot = p
            if slot < 0:
                continue
        else:
            points += 1
        at = POINT + slot * POINT_COLUMNS
        row[at + LOCAL_A] = float(k)
        row[at + GAP] = gap
        row[at + ARM_B] = (cubes[i, MATRIX] * x + cubes[i, MATRIX + 1] * y) + cubes[
            i, MATRIX + 2
        ] * z
        row[at + ARM_B + 1] = (cubes[i, MATRIX + 3] * x + cubes[i, MATRIX + 4] * y) + cubes[
            i, MATRIX + 5
        ] * z
        row[at + ARM_B + 2] = rz
        for n in range(3):
            row[at + ARM_A + n] = row[at + ARM_B + n] + cubes[i, PLACE + n]
    return points


@compiled
def prepare(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    counters: Integers,
    scratch: Floats,
    rules: Rules,
    count: int,
    first_row: int,
    ground: int,
    time: float,
    last_time: float,
) -> None:
    """
    Make the bodies and masses of the solution ready; list the contacts with the ground too.

    `time` is the length of a sub-step, `last_time` the one for which impulses are remembered, s.
    """
    w = rules.inverse_inertia
    active = counters[ACTIVES]
    for i in range(count):
        if marks[i, GROUPED]:
            asleep = marks[i, ASLEEP] != 0
            for n in range(3):
                cubes[i, SV + n] = state[7 + n, i]
                cubes[i, SW + n] = state[10 + n, i]
            for n in range(6):
                cubes[i, SHIFT + n] = 0.0
            cubes[i, INVERSE_MASS] = 0.0 if asleep else 1.0
            cubes[i, INVERSE_INERTIA] = 0.0 if asleep else w
            marks[i, TOUCHED] = 0
            if asleep:
                continue
            marks[i, AT_REST] = 0
            row = first_row + i
            points = stand_on_ground(
                state, cubes, marks, pairs, ends, scratch, rules, i, row, counters[PHASE]
            )
            ends[row, POINTS] = points
            if points > 0:
                ends[active, ACTIVE] = row
                ends[active, ACTIVE + 1] = ground
                ends[active, ACTIVE + 2] = i
                active += 1
                for p in range(points):
                    at = POINT + p * POINT_COLUMNS
                    k = int(pairs[row, at + LOCAL_A])
                    pairs[row, at + IMPULSE_N] = cubes[i, FORCE + 3 * k + 2] * time
                    pairs[row, at + IMPULSE_N + 1] = cubes[i, FORCE + 3 * k] * time
                    pairs[row, at + IMPULSE_N + 2] = cubes[i, FORCE + 3 * k + 1] * time
                    pairs[row, at + IMPULSE_N + 3] = 0.0
            for n in range(24):
                cubes[i, FORCE + n] = 0.0
    for n in range(6):
        cubes[ground, SV + n] = 0.0
        cubes[ground, SHIFT + n] = 0.0
    cubes[ground, INVERSE_MASS] = 0.0
    cubes[ground, INVERSE_INERTIA] = 0.0
    scale = time / last_time if last_time > 0.0 else 0.0
    for n in range(counters[ACTIVES]):
        number = ends[n, ACTIVE]
        for p in range(ends[number, POINTS]):
            for k in range(4):
                pairs[number, POINT + p * POINT_COLUMNS + IMPULSE_N + k] *= scale
    counters[ACTIVES] = active
    for n in range(active):
        number, a, b = ends[n, ACTIVE], ends[n, ACTIVE + 1], ends[n, ACTIVE + 2]
        row = pairs[number]
        mass = cubes[a, INVERSE_MASS] + cubes[b, INVERSE_MASS]
        nx, ny, nz = row[NORMAL], row[NORMAL + 1], row[NORMAL + 2]
        for p in range(ends[number, POINTS]):
            at = POINT + p * POINT_COLUMNS
            along, square = 0.0, 0.0
            for arm in (ARM_A, ARM_B):
                inertia = cubes[a if arm == ARM_A else b, INVERSE_INERTIA]
                x, y, z = row[at + arm], row[at + arm + 1], row[at + arm + 2]
                rr = (x * x + y * y) + z * z
                rn = (x * nx + y * ny) + z * nz
                along += inertia * (rr - rn * rn)
                square += inertia * rr
            row[at + MASS_N] = 1.0 / (mass + along)
            # The least mass of any direction: with it no friction step overshoots.
            row[at + MASS_T] = 1.0 / (mass + square)
            for k in range(3):
                row[at + TOTAL + k] = 0.0
