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
    ASLEEP,
    AT_REST,
    AXIS,
    BUILT,
    FORCE,
    GONE,
    GROUPED,
    ISLAND,
    KEPT_MEAN,
    KEPT_N,
    KEPT_T,
    LIST_A,
    LIST_B,
    LOCAL_A,
    LOCAL_B,
    LOCAL_NORMAL,
    MATRIX,
    MEAN,
    ON_PLANE,
    PAIR_POINT,
    PAIR_POINT_COLUMNS,
    PAIRS,
    PHASE,
    POINTS,
    POSE,
    PUSH,
    RIM,
    SEEN,
    SPEED,
    STAMP,
    STILL,
    WHICH,
)
from cube_sim.physics.contact.manifold import (
    edge_point,
    face_points,
    recall_impulses,
    remember_points,
)
from cube_sim.physics.contact.motion import closing
from cube_sim.physics.contact.neighbours import DIAGONAL
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.contact.solver import SLOP

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# In sides: cubes nearer than this are solved in common, whatever their speeds.
MARGIN = 0.01
# In sides and radians: cubes that moved less against each other keep their points.
UNCHANGED = 1e-3
RELATIVE = 20  # row of the scratch: the relative place of two cubes
HEIGHT = LOCAL_A + 1  # column of a corner at the ground: its height, m


@compiled
def take_up(cubes: Floats, marks: Integers, i: int, phase: int) -> None:
    """Write the rotation matrix of a cube to its row, once in a collision phase."""
    if marks[i, STAMP] == phase:
        return
    marks[i, STAMP] = phase
    cube = cubes[i]
    x, y, z, w = cube[POSE + 3], cube[POSE + 4], cube[POSE + 5], cube[POSE + 6]
    cube[MATRIX] = 1.0 - 2.0 * (y * y + z * z)
    cube[MATRIX + 1] = 2.0 * (x * y - z * w)
    cube[MATRIX + 2] = 2.0 * (x * z + y * w)
    cube[MATRIX + 3] = 2.0 * (x * y + z * w)
    cube[MATRIX + 4] = 1.0 - 2.0 * (x * x + z * z)
    cube[MATRIX + 5] = 2.0 * (y * z - x * w)
    cube[MATRIX + 6] = 2.0 * (x * z - y * w)
    cube[MATRIX + 7] = 2.0 * (y * z + x * w)
    cube[MATRIX + 8] = 1.0 - 2.0 * (x * x + y * y)


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
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    due: Floats,
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
    # What a pair may come nearer in the step beside its velocity, and shall be seen beforehand.
    slack = MARGIN * side + rules.gravity * rules.time_step * rules.time_step
    for i in range(count):
        marks[i, GROUPED] = 0
    # A touch wakes an island, whose own pairs then count: again, until no one wakes.
    woken = True
    while woken:
        woken = False
        active = 0
        for n in range(counters[PAIRS]):
            a, b, row = ends[n, near_list], ends[n, near_list + 1], ends[n, near_list + 2]
            asleep = marks[a, ASLEEP] + marks[b, ASLEEP]
            if asleep == 2:
                continue
            if ends[row, SEEN] != phase:
                known = ends[row, SEEN] >= 0
                ends[row, SEEN] = phase
                gone = cubes[a, GONE] + cubes[b, GONE]
                if ends[row, POINTS] > 0 and gone < due[row]:
                    # They have hardly moved: the points stay where they are on the cubes.
                    take_up(cubes, marks, a, phase)
                    take_up(cubes, marks, b, phase)
                else:
                    fastest = (cubes[a, SPEED] + cubes[a, RIM]) + (cubes[b, SPEED] + cubes[b, RIM])
                    far = known and ends[row, POINTS] == 0
                    if far and due[row] - gone > slack + fastest * rules.time_step:
                        continue
                    ends[row, POINTS] = find_points(
                        cubes,
                        marks,
                        pairs,
                        due,
                        ends,
                        scratch,
                        rules,
                        a,
                        b,
                        row,
                        gone,
                        slack,
                        phase,
                    )
            if ends[row, POINTS] == 0:
                continue
            if asleep == 1:
                near = SLOP * side + closing(cubes, a, b) * rules.time_step
                if least_gap(cubes, pairs[row], a, b, ends[row, POINTS]) <= near:
                    woken = True
                    wake(marks, cubes, a if marks[a, ASLEEP] else b, count)
            marks[a, GROUPED] = 1
            marks[b, GROUPED] = 1
            ends[active, ACTIVE] = row
            ends[active, ACTIVE + 1] = a
            ends[active, ACTIVE + 2] = b
            active += 1
        counters[ACTIVES] = active


@compiled
def find_points(
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    due: Floats,
    ends: Integers,
    scratch: Floats,
    rules: Rules,
    a: int,
    b: int,
    row: int,
    gone: float,
    slack: float,
    phase: int,
) -> int:
    """Find the points of a pair and return their number; note how far it is from having any."""
    margin = slack + closing(cubes, a, b) * rules.time_step
    x = cubes[b, POSE] - cubes[a, POSE]
    y = cubes[b, POSE + 1] - cubes[a, POSE + 1]
    z = cubes[b, POSE + 2] - cubes[a, POSE + 2]
    square = (x * x + y * y) + z * z
    reach = DIAGONAL * 2.0 * rules.half_side
    if square > (reach + margin) * (reach + margin):
        due[row] = gone + (math.sqrt(square) - reach)
        return 0
    take_up(cubes, marks, a, phase)
    take_up(cubes, marks, b, phase)
    return touch(cubes, pairs, due, ends, scratch, a, b, row, rules.half_side, margin, gone)


@compiled
def touch(
    cubes: Floats,
    pairs: Floats,
    due: Floats,
    ends: Integers,
    scratch: Floats,
    a: int,
    b: int,
    number: int,
    half_side: float,
    margin: float,
    gone: float,
) -> int:
    """Find the points of a pair, or keep those of the last step, and return their number."""
    row, place = pairs[number], scratch[RELATIVE]
    points: int = ends[number, POINTS]
    relate(cubes, a, b, place)
    moved = 1e300 if points == 0 else 0.0
    for n in range(12):
        scale = 1.0 if n < 9 else 1.0 / half_side
        moved = max(moved, abs(place[n] - row[BUILT + n]) * scale)
    if moved < UNCHANGED:
        due[number] = gone + (UNCHANGED - moved) * half_side
        return points
    habit = ends[number, AXIS] if points > 0 else NO_AXIS
    axis, gap = widest_axis(place, half_side, margin, habit)
    if axis == NO_AXIS:
        due[number] = gone + gap
        return 0
    remember_points(row, points, scratch)
    last = points
    if axis < FIRST_EDGE:
        points = face_points(place, axis, half_side, margin, row, scratch)
    else:
        points = edge_point(place, axis, half_side, row)
    recall_impulses(row, points, last, half_side, scratch)
    ends[number, AXIS] = axis
    due[number] = gone + UNCHANGED * half_side
    for n in range(12):
        row[BUILT + n] = place[n]
    return points


@compiled
def least_gap(cubes: Floats, row: Floats, a: int, b: int, points: int) -> float:
    """Return the least gap of the points of a pair, m."""
    first, second = cubes[a], cubes[b]
    least = 1e300
    for p in range(points):
        at = PAIR_POINT + p * PAIR_POINT_COLUMNS
        gap = 0.0
        for k in range(3):
            # In the axes of the first cube: where the point of the second lies, from its own.
            way = -row[at + LOCAL_A + k]
            for n in range(3):
                m = MATRIX + 3 * n
                far = (second[m] * row[at + LOCAL_B] + second[m + 1] * row[at + LOCAL_B + 1]) + (
                    second[m + 2] * row[at + LOCAL_B + 2]
                )
                way += first[m + k] * ((second[POSE + n] - first[POSE + n]) + far)
            gap += row[LOCAL_NORMAL + k] * way
        least = min(least, gap)
    return least


@compiled
def stand_on_ground(
    cubes: Floats, marks: Integers, row: Floats, rules: Rules, i: int, phase: int
) -> int:
    """Fill the row of a cube and the ground, at most its four lowest corners; return how many."""
    take_up(cubes, marks, i, phase)
    h = rules.half_side
    speed = cubes[i, SPEED] + cubes[i, RIM]
    margin = 2.0 * MARGIN * h + (speed + rules.gravity * rules.time_step) * rules.time_step
    if cubes[i, POSE + 2] - h * DIAGONAL > margin:
        return 0
    points = 0
    for k in range(8):
        x = h if k & 1 else -h
        y = h if k & 2 else -h
        z = h if k & 4 else -h
        rise = (cubes[i, MATRIX + 6] * x + cubes[i, MATRIX + 7] * y) + cubes[i, MATRIX + 8] * z
        gap = cubes[i, POSE + 2] + rise
        if gap >= margin:
            continue
        # A fifth one takes the place of the highest.
        slot = points
        if points == 4:
            slot, highest = -1, gap
            for p in range(4):
                other = row[PAIR_POINT + p * PAIR_POINT_COLUMNS + HEIGHT]
                if other > highest:
                    slot, highest = p, other
            if slot < 0:
                continue
        else:
            points += 1
        at = PAIR_POINT + slot * PAIR_POINT_COLUMNS
        row[at + LOCAL_A] = float(k)
        row[at + HEIGHT] = gap
        row[at + LOCAL_B] = x
        row[at + LOCAL_B + 1] = y
        row[at + LOCAL_B + 2] = z
    return points


@compiled
def forget_plane(cubes: Floats, marks: Integers, i: int) -> None:
    """Forget the forces and impulses of the plane on a cube."""
    for n in range(24):
        cubes[i, FORCE + n] = 0.0
        cubes[i, PUSH + n] = 0.0
    for n in range(8):
        cubes[i, MEAN + n] = 0.0
    marks[i, ON_PLANE] = 0


@compiled
def collide_with_ground(
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    counters: Integers,
    rules: Rules,
    count: int,
    first_row: int,
    ground: int,
    last_time: float,
) -> None:
    """
    Find the corners at the plane of all grouped cubes that are awake; list these as ACTIVE too.

    Their forces become the impulses of a sub-step of `last_time`, s, as the pairs remember theirs.
    """
    active = counters[ACTIVES]
    fall = rules.gravity * rules.time_step * rules.time_step
    near = (DIAGONAL + 2.0 * MARGIN) * rules.half_side + fall
    for i in range(count):
        high = near + (cubes[i, SPEED] + cubes[i, RIM]) * rules.time_step
        if not marks[i, GROUPED] or marks[i, ASLEEP]:
            continue
        if marks[i, ON_PLANE] == 0 and cubes[i, POSE + 2] > high:
            continue
        row = first_row + i
        points = stand_on_ground(cubes, marks, pairs[row], rules, i, counters[PHASE])
        ends[row, POINTS] = points
        if points > 0:
            ends[active, ACTIVE] = row
            ends[active, ACTIVE + 1] = ground
            ends[active, ACTIVE + 2] = i
            active += 1
            for p in range(points):
                at = PAIR_POINT + p * PAIR_POINT_COLUMNS
                mean = MEAN + int(pairs[row, at + LOCAL_A])
                corner = FORCE + 3 * int(pairs[row, at + LOCAL_A])
                pairs[row, at + KEPT_MEAN] = cubes[i, mean] * last_time
                pairs[row, at + KEPT_N] = cubes[i, corner + 2] * last_time
                pairs[row, at + KEPT_T] = cubes[i, corner] * last_time
                pairs[row, at + KEPT_T + 1] = cubes[i, corner + 1] * last_time
                pairs[row, at + KEPT_T + 2] = 0.0
        forget_plane(cubes, marks, i)
        marks[i, ON_PLANE] = 1 if points > 0 else 0
    counters[ACTIVES] = active
