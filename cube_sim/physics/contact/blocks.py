"""Bodies and blocks: what a solution in common works on, made from what touches, and read back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled, compiled_alone
from cube_sim.physics.contact.layout import (
    ACTED,
    ACTIVE,
    ACTIVES,
    ARM,
    ASLEEP,
    AT_REST,
    BLOCKS,
    BODIES,
    BODY_A,
    BODY_B,
    BODY_COLUMNS,
    CARRIED,
    CLOSING,
    COLOUR,
    COLOURS,
    COUNT,
    CROSS,
    CUBE,
    CUBE_A,
    CUBE_B,
    FAR,
    FIRST_GAP,
    FIRST_WAY,
    FORCE,
    FRICTION,
    GROUPED,
    HIT_ROOT,
    INERTIA_A,
    INERTIA_B,
    JN,
    JT,
    KEPT_MEAN,
    KEPT_N,
    KEY,
    LANES,
    LEAST,
    LENGTH,
    LOCAL_A,
    LOCAL_B,
    LOCAL_NORMAL,
    MASS_A,
    MASS_B,
    MASS_N,
    MASS_T,
    MATRIX,
    MEAN,
    MOST_COLOURS,
    MOST_POINTS,
    PAIR_POINT,
    PAIR_POINT_COLUMNS,
    POINT,
    POINT_SIZE,
    POINTS,
    POSE,
    PUSH,
    ROW,
    SHIFT,
    SLOT,
    TALLY,
    TOTAL,
    TOUCHED,
    N,
    V,
    X,
    Y,
    Z,
)
from cube_sim.physics.contact.rules import Rules

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# How fast a normal impulse is drawn to its mean of late, and how fast the mean follows it, 1/s.
# Drawn twice as fast, or followed at half the pace, a growing load is held late and a stack sags.
DRAWN, LEARNT = 24.0, 12.0


@compiled
def take_up_bodies(
    state: Floats, marks: Integers, bodies: Floats, counters: Integers, count: int
) -> None:
    """Give each awake cube of the solution a row of `bodies`; row 0 is what nothing moves."""
    for n in range(BODY_COLUMNS):
        bodies[0, n] = 0.0
    number = 1
    for i in range(count):
        marks[i, SLOT] = 0
        marks[i, COLOURS] = 0
        if marks[i, GROUPED] and not marks[i, ASLEEP]:
            marks[i, AT_REST] = 0
            marks[i, SLOT] = number
            marks[i, HIT_ROOT] = -1
            body = bodies[number]
            for n in range(6):
                body[V + n] = state[7 + n, i]
                body[SHIFT + n] = 0.0
            body[TOUCHED] = 0.0
            body[CARRIED] = 0.0
            body[CUBE] = float(i)
            number += 1
    counters[BODIES] = number


@compiled
def colour_pairs(marks: Integers, ends: Integers, counters: Integers) -> None:
    """
    Give each pair a colour that no other pair of its bodies has, and count them by KEY.

    One that finds no colour left (its cubes have some sixty contacts, so they are inside each
    other) is left out of this step.
    """
    for key in range(MOST_POINTS * MOST_COLOURS + 1):
        counters[TALLY + key] = 0
    for n in range(counters[ACTIVES]):
        row, a, b = ends[n, ACTIVE], ends[n, ACTIVE + 1], ends[n, ACTIVE + 2]
        used = 0
        if marks[a, SLOT] > 0:
            used |= marks[a, COLOURS]
        if marks[b, SLOT] > 0:
            used |= marks[b, COLOURS]
        colour = 0
        while colour < MOST_COLOURS and (used >> colour) & 1:
            colour += 1
        if colour == MOST_COLOURS:
            ends[n, KEY] = -1
            continue
        marks[a, COLOURS] |= 1 << colour
        marks[b, COLOURS] |= 1 << colour
        ends[n, KEY] = MOST_POINTS * colour + (MOST_POINTS - ends[row, POINTS])
        counters[TALLY + ends[n, KEY]] += 1


@compiled
def lay_out(ends: Integers, lanes: Integers, counters: Integers) -> None:
    """Open the blocks and give each pair its place, by colour, those with many points first."""
    place = 0
    for colour in range(MOST_COLOURS):
        first = place
        for k in range(MOST_POINTS):
            size = counters[TALLY + MOST_POINTS * colour + k]
            counters[TALLY + MOST_POINTS * colour + k] = place
            place += size
        if place > first:
            left = place - first
            block = first // LANES
            while left > 0:
                lanes[block, COLOUR] = colour
                lanes[block, LENGTH] = min(left, LANES)
                left -= LANES
                block += 1
            place = block * LANES
    counters[BLOCKS] = place // LANES
    for n in range(counters[ACTIVES]):
        key = ends[n, KEY]
        if key >= 0:
            place = counters[TALLY + key]
            counters[TALLY + key] += 1
            lane, i = lanes[place // LANES], place % LANES
            lane[ROW + i] = ends[n, ACTIVE]
            lane[CUBE_A + i] = ends[n, ACTIVE + 1]
            lane[CUBE_B + i] = ends[n, ACTIVE + 2]


@compiled
def fill_blocks(
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    counters: Integers,
    rules: Rules,
    ground: int,
    scale: float,
) -> None:
    """
    Write the pairs of all blocks; impulses of the last step count times `scale`.

    A normal impulse starts from where it was, drawn to its mean of late: what an unfinished
    solution does to a stack would make it sway, and so the swaying dies out. Where impulses are
    steady it changes nothing.
    """
    drawn = min(DRAWN * rules.time_step, 1.0)
    for k in range(counters[BLOCKS]):
        block, lane = blocks[k], lanes[k]
        # The first pair has the most points.
        lane[COUNT] = ends[lane[ROW], POINTS]
        if lane[LENGTH] < LANES:
            clear(block, lane)
        make_idle(block, lane)
        for i in range(lane[LENGTH]):
            row, a, b = lane[ROW + i], lane[CUBE_A + i], lane[CUBE_B + i]
            lane[BODY_A + i] = marks[a, SLOT]
            lane[BODY_B + i] = marks[b, SLOT]
            block[FRICTION + i] = rules.friction
            moves_a, moves_b = marks[a, SLOT] > 0, marks[b, SLOT] > 0
            block[MASS_A + i] = 1.0 if moves_a else 0.0
            block[MASS_B + i] = 1.0 if moves_b else 0.0
            block[INERTIA_A + i] = rules.inverse_inertia if moves_a else 0.0
            block[INERTIA_B + i] = rules.inverse_inertia if moves_b else 0.0
            points = ends[row, POINTS]
            if a == ground:
                place_on_ground(cubes, pairs[row], block, i, b, points)
            else:
                place_pair(cubes, pairs[row], block, i, a, b, points)
            for p in range(points):
                start = POINT + p * POINT_SIZE
                at = PAIR_POINT + p * PAIR_POINT_COLUMNS + KEPT_N
                for c in range(4):
                    block[start + JN + c * LANES + i] = pairs[row, at + c] * scale
                mean, jn = pairs[row, at + KEPT_MEAN - KEPT_N], pairs[row, at]
                if jn > 0.0:
                    bodies[marks[a, SLOT], CARRIED] = 1.0
                    bodies[marks[b, SLOT], CARRIED] = 1.0
                if mean > 0.0 and jn > 0.0:
                    block[start + JN + i] = (jn + drawn * (mean - jn)) * scale
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            weigh(block, block[start : start + POINT_SIZE])
    for k in range(counters[BLOCKS]):
        block, lane = blocks[k], lanes[k]
        for i in range(LANES):
            # What nothing moves does not fall, nor does what is carried.
            falls_a = block[MASS_A + i] * (1.0 - bodies[lane[BODY_A + i], CARRIED])
            falls_b = block[MASS_B + i] * (1.0 - bodies[lane[BODY_B + i], CARRIED])
            gx, gy, gz = rules.gx, rules.gy, rules.gz
            along = (gx * block[N + X + i] + gy * block[N + Y + i]) + gz * block[N + Z + i]
            block[CLOSING + i] = (falls_a - falls_b) * along


@compiled
def clear(block: Floats, lane: Integers) -> None:
    """Make a block of pairs between bodies that nothing moves, without a point."""
    for n in range(POINT + lane[COUNT] * POINT_SIZE):
        block[n] = 0.0
    for i in range(LANES):
        lane[BODY_A + i] = 0
        lane[BODY_B + i] = 0
    make_idle(block, lane)


@compiled
def make_idle(block: Floats, lane: Integers) -> None:
    """Put all points of a block out of reach and take their impulses away."""
    for i in range(LANES):
        block[ACTED + i] = 0.0
    for p in range(lane[COUNT]):
        point = block[POINT + p * POINT_SIZE : POINT + (p + 1) * POINT_SIZE]
        for i in range(LANES):
            point[FIRST_GAP + i] = FAR
            for c in range(0, 3 * LANES, LANES):
                point[ARM + c + i] = 0.0
                point[TOTAL + c + i] = 0.0
            for c in range(JN, JT + 3 * LANES, LANES):
                point[c + i] = 0.0


@compiled
def place_pair(
    cubes: Floats, row: Floats, block: Floats, i: int, a: int, b: int, points: int
) -> None:
    """Write normal, way, arms and gaps of two cubes, in world, to lane i of a block."""
    first, second = cubes[a], cubes[b]
    for k in range(3):
        m = MATRIX + 3 * k
        block[N + k * LANES + i] = (
            first[m] * row[LOCAL_NORMAL] + first[m + 1] * row[LOCAL_NORMAL + 1]
        ) + first[m + 2] * row[LOCAL_NORMAL + 2]
        block[FIRST_WAY + k * LANES + i] = second[POSE + k] - first[POSE + k]
    least = 1e300
    for p in range(points):
        at = PAIR_POINT + p * PAIR_POINT_COLUMNS
        point = block[POINT + p * POINT_SIZE : POINT + (p + 1) * POINT_SIZE]
        gap = 0.0
        for k in range(3):
            m = MATRIX + 3 * k
            on_a = (first[m] * row[at + LOCAL_A] + first[m + 1] * row[at + LOCAL_A + 1]) + (
                first[m + 2] * row[at + LOCAL_A + 2]
            )
            on_b = (second[m] * row[at + LOCAL_B] + second[m + 1] * row[at + LOCAL_B + 1]) + (
                second[m + 2] * row[at + LOCAL_B + 2]
            )
            on_b += block[FIRST_WAY + k * LANES + i]
            gap += block[N + k * LANES + i] * (on_b - on_a)
            # One point for both, or an impulse would turn the two as a whole.
            point[ARM + k * LANES + i] = 0.5 * (on_b + on_a)
        point[FIRST_GAP + i] = gap
        least = min(least, gap)
    row[LEAST] = least


@compiled
def place_on_ground(cubes: Floats, row: Floats, block: Floats, i: int, b: int, points: int) -> None:
    """Write the same for corners of a cube and the ground, of which no arm matters."""
    block[N + X + i] = 0.0
    block[N + Y + i] = 0.0
    block[N + Z + i] = 1.0
    for c in range(0, 3 * LANES, LANES):
        block[FIRST_WAY + c + i] = 0.0
    for p in range(points):
        at = PAIR_POINT + p * PAIR_POINT_COLUMNS
        point = block[POINT + p * POINT_SIZE : POINT + (p + 1) * POINT_SIZE]
        for k in range(3):
            m = MATRIX + 3 * k
            point[ARM + k * LANES + i] = (
                cubes[b, m] * row[at + LOCAL_B] + cubes[b, m + 1] * row[at + LOCAL_B + 1]
            ) + cubes[b, m + 2] * row[at + LOCAL_B + 2]
        point[FIRST_GAP + i] = cubes[b, POSE + 2] + point[ARM + 2 * LANES + i]


@compiled_alone
def weigh(block: Floats, point: Floats) -> None:
    """Write the effective masses of a point of each pair, and what a normal impulse drags along."""
    for i in range(LANES):
        nx, ny, nz = block[N + X + i], block[N + Y + i], block[N + Z + i]
        ax, ay, az = point[ARM + X + i], point[ARM + Y + i], point[ARM + Z + i]
        bx = ax - block[FIRST_WAY + X + i]
        by = ay - block[FIRST_WAY + Y + i]
        bz = az - block[FIRST_WAY + Z + i]
        inertia_a, inertia_b = block[INERTIA_A + i], block[INERTIA_B + i]
        aa, an = (ax * ax + ay * ay) + az * az, (ax * nx + ay * ny) + az * nz
        bb, bn = (bx * bx + by * by) + bz * bz, (bx * nx + by * ny) + bz * nz
        mass = block[MASS_A + i] + block[MASS_B + i]
        along = inertia_a * (aa - an * an) + inertia_b * (bb - bn * bn)
        there = mass > 0.0
        point[MASS_N + i] = 1.0 / (mass + along) if there else 0.0
        # The least mass of any direction: with it no friction step overshoots.
        square = inertia_a * aa + inertia_b * bb
        point[MASS_T + i] = 1.0 / (mass + square) if there else 0.0
        # The tangential part of K n, K = 1/m + (|r|^2 - r r^T)/I.
        ka, kb = inertia_a * an, inertia_b * bn
        point[CROSS + X + i] = -(ka * (ax - an * nx)) - kb * (bx - bn * nx)
        point[CROSS + Y + i] = -(ka * (ay - an * ny)) - kb * (by - bn * ny)
        point[CROSS + Z + i] = -(ka * (az - an * nz)) - kb * (bz - bn * nz)


@compiled
def read_back(
    cubes: Floats,
    pairs: Floats,
    ends: Integers,
    blocks: Floats,
    lanes: Integers,
    counters: Integers,
    rules: Rules,
    ground: int,
    scale: float,
    time: float,
) -> None:
    """
    Remember the impulses for the next step, and what the plane did to each corner.

    `time` is the length of a sub-step, s; means of the last step count times `scale`.
    """
    learnt = min(LEARNT * rules.time_step, 1.0)
    for n in range(counters[BLOCKS]):
        block, lane = blocks[n], lanes[n]
        for i in range(lane[LENGTH]):
            row = pairs[lane[ROW + i]]
            b = lane[CUBE_B + i]
            for p in range(ends[lane[ROW + i], POINTS]):
                at = PAIR_POINT + p * PAIR_POINT_COLUMNS
                point = block[POINT + p * POINT_SIZE : POINT + (p + 1) * POINT_SIZE]
                mean, jn = row[at + KEPT_MEAN] * scale, point[JN + i]
                mean = mean + learnt * (jn - mean) if mean > 0.0 else jn
                row[at + KEPT_MEAN] = mean
                if lane[CUBE_A + i] == ground:
                    cubes[b, MEAN + int(row[at + LOCAL_A])] = mean / time
                    corner = 3 * int(row[at + LOCAL_A])
                    cubes[b, FORCE + corner] = point[JT + i] / time
                    cubes[b, FORCE + corner + 1] = point[JT + LANES + i] / time
                    cubes[b, FORCE + corner + 2] = point[JN + i] / time
                    for k in range(3):
                        cubes[b, PUSH + corner + k] = point[TOTAL + k * LANES + i]
                else:
                    for k in range(4):
                        row[at + KEPT_N + k] = point[JN + k * LANES + i]


@compiled
def note_touched(blocks: Floats, lanes: Integers, bodies: Floats, first: int, last: int) -> None:
    """Mark the bodies that an impulse has moved, even if a later one took it back."""
    for n in range(first, last):
        for i in range(LANES):
            if blocks[n, ACTED + i] > 0.0:
                bodies[lanes[n, BODY_A + i], TOUCHED] = 1.0
                bodies[lanes[n, BODY_B + i], TOUCHED] = 1.0
