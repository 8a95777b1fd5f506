"""Impacts of a sub-step: restitution and friction of what hits, and the energy that it may keep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.blocks import clear, note_touched
from cube_sim.physics.contact.forest import join, root
from cube_sim.physics.contact.layout import (
    BEFORE,
    BLOCKS,
    BODY_A,
    BODY_B,
    BOUNCE,
    COLOUR,
    COUNT,
    CUBE,
    CUBE_A,
    CUBE_B,
    ENERGY,
    FRICTION,
    HIT_ROOT,
    HITS,
    JN,
    JT,
    LANES,
    LENGTH,
    MEMBER,
    POINT,
    POINT_SIZE,
    SETTLED,
    SOURCE,
    TARGET,
    TOTAL,
    N,
    V,
    W,
)
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.contact.solver import ANYTHING, sweep

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_SWEEPS, MOST_ATTEMPTS = 80, 4
# An impact is solved when no impulse changes by more than this share of the fastest hit.
ENOUGH = 1e-9


@compiled
def solve_impacts(
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    work: Floats,
    counters: Integers,
    rules: Rules,
) -> int:
    """
    Turn back the pairs that were found to hit; return the sweeps that it took.

    Of such a pair all points that touch take part. Gauss-Seidel until the impulses stand
    still: normal and tangential parts come out coupled. Restitution with friction could create
    energy; a group of cubes in which it does is solved again with less friction, at last with
    none.
    """
    first = counters[BLOCKS]
    last = gather_hits(blocks, lanes, first)
    fastest = 0.0
    for k in range(first, last):
        for i in range(LANES):
            fastest = max(fastest, blocks[k, HITS + i])
    members = gather_members(cubes, marks, ends, bodies, lanes, first, last)
    for n in range(members):
        add_energy(cubes, marks, bodies, ends[n, MEMBER], rules, ENERGY)
    enough = ENOUGH * fastest
    sweeps = 0
    for attempt in range(MOST_ATTEMPTS):
        for n in range(MOST_SWEEPS):
            backward = n % 2 == 1
            unsettled = sweep(blocks, lanes, bodies, work, first, last, backward, enough, False)
            sweeps += 1
            if unsettled == 0:
                # Who was settled may since have been moved by a neighbour.
                sweeps += 1
                if sweep(blocks, lanes, bodies, work, first, last, not backward, enough, True) == 0:
                    break
        share = 0.5 if attempt < MOST_ATTEMPTS - 2 else 0.0
        if attempt == MOST_ATTEMPTS - 1 or not take_back(
            cubes, marks, ends, bodies, blocks, lanes, rules, first, last, members, share
        ):
            break
    note_touched(blocks, lanes, bodies, first, last)
    for n in range(members):
        marks[int(bodies[ends[n, MEMBER], CUBE]), HIT_ROOT] = -1
    add_to_totals(blocks, lanes, first, last)
    return sweeps


@compiled
def gather_hits(blocks: Floats, lanes: Integers, first: int) -> int:
    """Copy the pairs that hit into blocks of their own, `first` to the one before the result."""
    last = first
    for k in range(first):
        block, lane = blocks[k], lanes[k]
        for i in range(lane[LENGTH]):
            if block[HITS + i] == 0.0:
                continue
            if (
                last == first
                or lanes[last - 1, COLOUR] != lane[COLOUR]
                or lanes[last - 1, LENGTH] == LANES
            ):
                # The first pair of a colour has the most points.
                lanes[last, COUNT] = lane[COUNT]
                lanes[last, COLOUR] = lane[COLOUR]
                lanes[last, LENGTH] = 0
                lanes[last, SETTLED] = 0
                clear(blocks[last], lanes[last])
                last += 1
            own, own_lane = blocks[last - 1], lanes[last - 1]
            place = own_lane[LENGTH]
            own_lane[LENGTH] += 1
            own_lane[SOURCE + place] = k * LANES + i
            for c in range(BODY_A, SOURCE, LANES):
                own_lane[c + place] = lane[c + i]
            for c in range(0, POINT, LANES):
                own[c + place] = block[c + i]
            for p in range(lane[COUNT]):
                start = POINT + p * POINT_SIZE
                for c in range(start, start + POINT_SIZE, LANES):
                    own[c + place] = block[c + i]
                for c in range(start + JN, start + JT + 3 * LANES, LANES):
                    own[c + place] = 0.0
                bounce = block[start + BOUNCE + i]
                own[start + TARGET + place] = bounce if bounce >= 0.0 else ANYTHING
    return last


@compiled
def gather_members(
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    bodies: Floats,
    lanes: Integers,
    first: int,
    last: int,
) -> int:
    """List the bodies that impacts move, as groups that are joined by them; return how many."""
    members = 0
    for k in range(first, last):
        lane = lanes[k]
        for i in range(lane[LENGTH]):
            for side in range(2):
                slot = lane[(BODY_B if side else BODY_A) + i]
                cube = lane[(CUBE_B if side else CUBE_A) + i]
                if slot > 0 and marks[cube, HIT_ROOT] < 0:
                    marks[cube, HIT_ROOT] = cube
                    cubes[cube, ENERGY] = 0.0
                    for n in range(6):
                        bodies[slot, BEFORE + n] = bodies[slot, V + n]
                    ends[members, MEMBER] = slot
                    members += 1
            if lane[BODY_A + i] > 0 and lane[BODY_B + i] > 0:
                join(marks, HIT_ROOT, lane[CUBE_A + i], lane[CUBE_B + i])
    return members


@compiled
def add_energy(
    cubes: Floats, marks: Integers, bodies: Floats, slot: int, rules: Rules, column: int
) -> None:
    """Add the kinetic energy of a body to that of its group."""
    total = 0.0
    for n in range(3):
        total += bodies[slot, V + n] * bodies[slot, V + n]
        total += bodies[slot, W + n] * bodies[slot, W + n] / rules.inverse_inertia
    cubes[root(marks, HIT_ROOT, int(bodies[slot, CUBE])), column] += 0.5 * total


@compiled
def take_back(
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    rules: Rules,
    first: int,
    last: int,
    members: int,
    share: float,
) -> bool:
    """Undo the groups that gained energy and leave a `share` of their friction; say if any did."""
    for n in range(members):
        cubes[int(bodies[ends[n, MEMBER], CUBE]), ENERGY + 1] = 0.0
    for n in range(members):
        add_energy(cubes, marks, bodies, ends[n, MEMBER], rules, ENERGY + 1)
    undone = False
    for n in range(members):
        slot = ends[n, MEMBER]
        group = root(marks, HIT_ROOT, int(bodies[slot, CUBE]))
        if cubes[group, ENERGY + 1] > cubes[group, ENERGY] * (1.0 + 1e-12):
            undone = True
            for k in range(6):
                bodies[slot, V + k] = bodies[slot, BEFORE + k]
    if not undone:
        return False
    for k in range(first, last):
        block, lane = blocks[k], lanes[k]
        for i in range(lane[LENGTH]):
            cube = lane[CUBE_A + i] if lane[BODY_A + i] > 0 else lane[CUBE_B + i]
            group = root(marks, HIT_ROOT, cube)
            if cubes[group, ENERGY + 1] > cubes[group, ENERGY] * (1.0 + 1e-12):
                block[FRICTION + i] *= share
                lane[SETTLED] = 0
                for p in range(lane[COUNT]):
                    start = POINT + p * POINT_SIZE
                    for c in range(start + JN, start + JT + 3 * LANES, LANES):
                        block[c + i] = 0.0
    return True


@compiled
def add_to_totals(blocks: Floats, lanes: Integers, first: int, last: int) -> None:
    """Add the impulses of the impacts to the totals of their pairs."""
    for k in range(first, last):
        block, lane = blocks[k], lanes[k]
        for i in range(lane[LENGTH]):
            source, j = blocks[lane[SOURCE + i] // LANES], lane[SOURCE + i] % LANES
            for p in range(lane[COUNT]):
                start = POINT + p * POINT_SIZE
                for c in range(0, 3 * LANES, LANES):
                    source[start + TOTAL + c + j] += (
                        block[start + JN + i] * block[N + c + i] + block[start + JT + c + i]
                    )
