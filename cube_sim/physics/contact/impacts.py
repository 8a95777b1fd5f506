"""Impacts of a sub-step: restitution and friction of what hits, and the energy that it may keep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.blocks import clear, note_touched
from cube_sim.physics.contact.forest import join
from cube_sim.physics.contact.impact_energy import hold_energy, note_energy, take_back
from cube_sim.physics.contact.layout import (
    ACTIVES,
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
    GAP,
    HIT_ROOT,
    HITS,
    JN,
    JT,
    LANES,
    LENGTH,
    MEMBER,
    POINT,
    POINT_SIZE,
    SOURCE,
    TARGET,
    TOTAL,
    N,
    V,
    X,
    Y,
    Z,
)
from cube_sim.physics.contact.relative_motion import arms_now, parting
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.contact.solver import ANYTHING, sweep, take_one

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_ATTEMPTS = 4
# An impact is solved when no impulse changes by more than ENOUGH, a share of the fastest hit, or
# after so many VISITS of pairs. It goes on through what touches for ROUNDS, shared among the cubes
# that take part. In a crowd, a solution of more than FEW_PAIRS, all of these end sooner.
ENOUGH, VISITS, ROUNDS = 1e-9, 16000, 24
ENOUGH_OF_A_CROWD, VISITS_OF_A_CROWD, ROUNDS_OF_A_CROWD, FEW_PAIRS = 1e-3, 3000, 1, 64
FEWEST_SWEEPS = 12
# What touches takes part when it would be driven together with this share of the fastest hit.
DRIVEN = 5e-3


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
    slop: float,
) -> int:
    """
    Turn back the pairs that were found to hit; return the sweeps that it took.

    Of such a pair all points that touch take part. Gauss-Seidel until the impulses stand
    still: normal and tangential parts come out coupled. What touches a cube that is hit holds it:
    round after round, pairs that the impact would drive together join the solution, without
    restitution. Restitution with friction could create energy; a group of cubes in which it does
    is solved again with less friction, at last with none, and what an unfinished solution still
    gains is taken away by a scale of all its impulses.
    """
    first = counters[BLOCKS]
    last = gather_hits(blocks, lanes, first)
    fastest = 0.0
    for k in range(first, last):
        for i in range(LANES):
            fastest = max(fastest, blocks[k, HITS + i])
    members = gather_members(marks, ends, bodies, lanes, first, last, 0)
    crowded = counters[ACTIVES] > FEW_PAIRS
    enough = (ENOUGH_OF_A_CROWD if crowded else ENOUGH) * fastest
    visits = VISITS_OF_A_CROWD if crowded else VISITS
    sweeps = settle(blocks, lanes, bodies, work, first, last, enough, visits)
    for _ in range(ROUNDS_OF_A_CROWD if crowded else max(ROUNDS // members, 1)):
        grown = gather_driven(
            marks, bodies, blocks, lanes, work, first, last, slop, DRIVEN * fastest
        )
        if grown == last:
            break
        members = gather_members(marks, ends, bodies, lanes, last, grown, members)
        last = grown
        sweeps += settle(blocks, lanes, bodies, work, first, last, enough, visits)
    note_energy(cubes, marks, ends, bodies, rules, members, BEFORE, BEFORE, ENERGY)
    note_energy(cubes, marks, ends, bodies, rules, members, V, V, ENERGY + 1)
    for attempt in range(1, MOST_ATTEMPTS):
        share = 0.5 if attempt < MOST_ATTEMPTS - 1 else 0.0
        if not take_back(cubes, marks, ends, bodies, blocks, lanes, first, last, members, share):
            break
        sweeps += settle(blocks, lanes, bodies, work, first, last, enough, visits)
        note_energy(cubes, marks, ends, bodies, rules, members, V, V, ENERGY + 1)
    hold_energy(cubes, marks, ends, bodies, blocks, lanes, rules, first, last, members)
    note_touched(blocks, lanes, bodies, first, last)
    for n in range(members):
        marks[int(bodies[ends[n, MEMBER], CUBE]), HIT_ROOT] = -1
    add_to_totals(blocks, lanes, first, last)
    return sweeps


@compiled
def settle(
    blocks: Floats,
    lanes: Integers,
    bodies: Floats,
    work: Floats,
    first: int,
    last: int,
    enough: float,
    visits: int,
) -> int:
    """Sweep to and fro until no impulse changes by more than `enough`, N s; return how often."""
    most = max(FEWEST_SWEEPS, visits // (LANES * (last - first)))
    for n in range(most):
        if sweep(blocks, lanes, bodies, work, first, last, n % 2 == 1, enough) == 0:
            return n + 1
    return most


@compiled
def gather_hits(blocks: Floats, lanes: Integers, first: int) -> int:
    """Copy the pairs that hit into blocks of their own, `first` to the one before the result."""
    last = first
    for k in range(first):
        for i in range(lanes[k, LENGTH]):
            if blocks[k, HITS + i] > 0.0:
                last = copy_pair(blocks, lanes, k, i, first, last)
    return last


@compiled
def gather_driven(
    marks: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    work: Floats,
    first: int,
    last: int,
    slop: float,
    limit: float,
) -> int:
    """
    Copy the pairs that an impact drives together faster than `limit`, m/s, as `gather_hits` does.

    One of their cubes takes part in the impact, and they touch.
    """
    begin = last
    for k in range(first):
        block, lane = blocks[k], lanes[k]
        for i in range(lane[LENGTH]):
            if block[HITS + i] > 0.0 or last == len(blocks):
                continue
            joins = lane[BODY_A + i] > 0 and marks[lane[CUBE_A + i], HIT_ROOT] >= 0
            joins = joins or (lane[BODY_B + i] > 0 and marks[lane[CUBE_B + i], HIT_ROOT] >= 0)
            if joins:
                take_one(bodies, lane, V, work, i)
                driven = hold(block, lane[COUNT], work, i, slop)
                if driven > limit:
                    block[HITS + i] = driven
                    last = copy_pair(blocks, lanes, k, i, begin, last)
    return last


@compiled
def hold(block: Floats, count: int, work: Floats, i: int, slop: float) -> float:
    """Make pair i of a block hold where it touches; return how fast it is driven together, m/s."""
    driven = 0.0
    for p in range(count):
        point = block[POINT + p * POINT_SIZE : POINT + (p + 1) * POINT_SIZE]
        point[BOUNCE + i] = -1.0
        if point[JN + i] > 0.0 or point[GAP + i] <= slop:
            point[BOUNCE + i] = 0.0
            ux, uy, uz = parting(work, i, arms_now(block, point, i))
            un = (ux * block[N + X + i] + uy * block[N + Y + i]) + uz * block[N + Z + i]
            driven = max(driven, -un)
    return driven


@compiled
def copy_pair(blocks: Floats, lanes: Integers, k: int, i: int, begin: int, last: int) -> int:
    """
    Copy lane i of block k into the blocks of an impact that begin at `begin`; return their end.

    The last of them takes it if it is of the same colour and has room, else a new one is opened.
    """
    block, lane = blocks[k], lanes[k]
    if last == begin or lanes[last - 1, COLOUR] != lane[COLOUR] or lanes[last - 1, LENGTH] == LANES:
        # The first pair of a colour has the most points.
        lanes[last, COUNT] = lane[COUNT]
        lanes[last, COLOUR] = lane[COLOUR]
        lanes[last, LENGTH] = 0
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
    marks: Integers,
    ends: Integers,
    bodies: Floats,
    lanes: Integers,
    first: int,
    last: int,
    members: int,
) -> int:
    """
    List the bodies that impacts move, as groups that are joined by them; return how many.

    Those of the blocks `first` to `last` - 1 are added to the `members` there are.
    """
    for k in range(first, last):
        lane = lanes[k]
        for i in range(lane[LENGTH]):
            for side in range(2):
                slot = lane[(BODY_B if side else BODY_A) + i]
                cube = lane[(CUBE_B if side else CUBE_A) + i]
                if slot > 0 and marks[cube, HIT_ROOT] < 0:
                    marks[cube, HIT_ROOT] = cube
                    for n in range(6):
                        bodies[slot, BEFORE + n] = bodies[slot, V + n]
                    ends[members, MEMBER] = slot
                    members += 1
            if lane[BODY_A + i] > 0 and lane[BODY_B + i] > 0:
                join(marks, HIT_ROOT, lane[CUBE_A + i], lane[CUBE_B + i])
    return members


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
