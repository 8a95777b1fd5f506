"""
Overlap is taken away by velocities of its own, which move the cubes and are then forgotten.

They never reach the velocities proper, nor the impulses that the next sub-step starts from: what
an unfinished solution leaves of a push would feed the next one, and stacks would sway for ever.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled, compiled_alone
from cube_sim.physics.contact.layout import (
    BLOCKS,
    BODIES,
    BODY_A,
    BODY_B,
    COUNT,
    DEEP,
    GAP,
    INERTIA_A,
    INERTIA_B,
    JP,
    LANES,
    MASS_A,
    MASS_B,
    MASS_N,
    MOVED,
    POINT,
    POINT_SIZE,
    PUSHED,
    PUSHING,
    TARGET,
    TOUCHED,
    N,
    V,
    W,
    X,
    Y,
    Z,
)
from cube_sim.physics.contact.relative_motion import apply_to_both, arms_now, cross, parting
from cube_sim.physics.contact.solver import give, give_one, take, take_one

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Overlap goes with the rate PUSH_OUT, 1/s, no faster than FASTEST_PUSH, m/s.
PUSH_OUT, FASTEST_PUSH = 15.0, 2.0
# A push is solved when none changes by more than this, N s.
ENOUGH = 1e-9


@compiled
def push_apart(
    blocks: Floats,
    lanes: Integers,
    bodies: Floats,
    work: Floats,
    counters: Integers,
    time: float,
    slop: float,
    most: int,
) -> int:
    """
    Find the velocities PUSHED that take overlap away in a sub-step of `time`, s.

    Normal impulses alone, in at most `most` sweeps over what overlaps by more than `slop`, m, and
    what is moved by that; return how many sweeps it took.
    """
    count = counters[BLOCKS]
    deep = 0
    for k in range(count):
        deep += lanes[k, DEEP]
    for n in range(counters[BODIES]):
        for c in range(PUSHED, PUSHING + 1):
            bodies[n, c] = 0.0
    if deep == 0:
        return 0
    for k in range(count):
        block, lane = blocks[k], lanes[k]
        if lane[DEEP]:
            take(bodies, lane, V, work)
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            aim_push(block, block[start : start + POINT_SIZE], work, time, slop, lane[DEEP])
    for n in range(most):
        unsettled = 0
        for m in range(count):
            k = count - 1 - m if n % 2 == 1 else m
            block, lane = blocks[k], lanes[k]
            pushing = 0.0
            for i in range(LANES):
                pushing += bodies[lane[BODY_A + i], PUSHING] + bodies[lane[BODY_B + i], PUSHING]
            if lane[DEEP] == 0 and pushing == 0.0:
                continue
            take(bodies, lane, PUSHED, work)
            changed = 0
            for p in range(lane[COUNT]):
                start = POINT + p * POINT_SIZE
                changed += part(block, block[start : start + POINT_SIZE], work)
            if changed > 0:
                give(bodies, lane, PUSHED, work)
                for i in range(LANES):
                    for slot in (lane[BODY_A + i], lane[BODY_B + i]):
                        bodies[slot, PUSHING] = 1.0
                        bodies[slot, TOUCHED] = 1.0
                bodies[0, PUSHING] = 0.0
            unsettled += changed
        if unsettled == 0:
            return n + 1
    return most


@compiled_alone
def aim_push(
    block: Floats, point: Floats, work: Floats, time: float, slop: float, deep: int
) -> None:
    """
    Write the velocity at which one point of each pair is to be pushed apart as its TARGET.

    What parts by itself needs no push; what does not overlap may be pushed up to the slop.
    """
    rate, per_time = min(PUSH_OUT, 0.2 / time), 1.0 / time
    for i in range(LANES):
        point[JP + i] = 0.0
        over = -(point[GAP + i] + slop)
        target = per_time * over
        if deep and over > 0.0:
            ux, uy, uz = parting(work, i, arms_now(block, point, i))
            un = (ux * block[N + X + i] + uy * block[N + Y + i]) + uz * block[N + Z + i]
            target = max(min(rate * over, FASTEST_PUSH) - max(un, 0.0), 0.0)
        point[TARGET + i] = target


@compiled_alone
def part(block: Floats, point: Floats, work: Floats) -> int:
    """Push one point of each pair apart; return how many changed by more than ENOUGH, N s."""
    changed = 0
    for i in range(LANES):
        nx, ny, nz = block[N + X + i], block[N + Y + i], block[N + Z + i]
        arms = arms_now(block, point, i)
        ux, uy, uz = parting(work, i, arms)
        un = (ux * nx + uy * ny) + uz * nz
        old = point[JP + i]
        new = max(old + point[MASS_N + i] * (point[TARGET + i] - un), 0.0)
        change = new - old
        changed += abs(change) > ENOUGH
        point[JP + i] = new
        apply_to_both(block, work, i, arms, change * nx, change * ny, change * nz)
    return changed


@compiled
def keep_angular_momentum(
    blocks: Floats, lanes: Integers, bodies: Floats, work: Floats, counters: Integers, time: float
) -> None:
    """
    Turn pushed pairs by what moving their centres without their momentum did to the angular one.

    To be called when a sub-step of `time`, s, has moved them (`move_along`). It is as if the push J
    had been given before the motion and taken back after it, each in the point that both share:
    the velocities are as before, and each spin gains d x J / I, where 2 d is how far their
    velocities have moved the centres against each other (pushes add up to nothing). What energy
    that gives is taken from their sliding.
    """
    half = 0.5 * time
    for k in range(counters[BLOCKS]):
        block, lane = blocks[k], lanes[k]
        for i in range(LANES):
            a, b = bodies[lane[BODY_A + i]], bodies[lane[BODY_B + i]]
            if lane[BODY_A + i] == 0 or lane[BODY_B + i] == 0 or a[PUSHING] == 0.0:
                continue
            push, most, hardest = 0.0, 0.0, 0
            for p in range(lane[COUNT]):
                jp = block[POINT + p * POINT_SIZE + JP + i]
                push += jp
                if jp > most:
                    most, hardest = jp, p
            if push == 0.0:
                continue
            x, y, z = cross(
                block[MOVED + X + i] - half * (b[PUSHED] - a[PUSHED]),
                block[MOVED + Y + i] - half * (b[PUSHED + 1] - a[PUSHED + 1]),
                block[MOVED + Z + i] - half * (b[PUSHED + 2] - a[PUSHED + 2]),
                push * block[N + X + i],
                push * block[N + Y + i],
                push * block[N + Z + i],
            )
            # I (w + d x J / I)^2 / 2 - I w^2 / 2, of both.
            turn = block[INERTIA_A + i]
            gain = turn * ((x * x + y * y) + z * z)
            gain += ((a[W] + b[W]) * x + (a[W + 1] + b[W + 1]) * y) + (a[W + 2] + b[W + 2]) * z
            for body in (a, b):
                body[W] += turn * x
                body[W + 1] += turn * y
                body[W + 2] += turn * z
            if gain > 0.0:
                take_one(bodies, lane, V, work, i)
                start = POINT + hardest * POINT_SIZE
                slow(block, block[start : start + POINT_SIZE], work, i, gain)
                give_one(bodies, lane, V, work, i)


@compiled
def slow(block: Floats, point: Floats, work: Floats, i: int, energy: float) -> None:
    """Take so much energy, J, from the sliding of pair i at a point, or as much as there is."""
    nx, ny, nz = block[N + X + i], block[N + Y + i], block[N + Z + i]
    arms = arms_now(block, point, i)
    ux, uy, uz = parting(work, i, arms)
    un = (ux * nx + uy * ny) + uz * nz
    ux, uy, uz = ux - un * nx, uy - un * ny, uz - un * nz
    speed = math.sqrt((ux * ux + uy * uy) + uz * uz)
    if speed == 0.0:
        return
    tx, ty, tz = ux / speed, uy / speed, uz / speed
    ax, ay, az = cross(arms[0], arms[1], arms[2], tx, ty, tz)
    bx, by, bz = cross(arms[3], arms[4], arms[5], tx, ty, tz)
    inverse = block[MASS_A + i] + block[MASS_B + i]
    inverse += block[INERTIA_A + i] * ((ax * ax + ay * ay) + az * az)
    inverse += block[INERTIA_B + i] * ((bx * bx + by * by) + bz * bz)
    # The impulse j for which j speed - j^2 inverse / 2 is the energy.
    left = max(speed * speed - 2.0 * inverse * energy, 0.0)
    j = (speed - math.sqrt(left)) / inverse
    apply_to_both(block, work, i, arms, -j * tx, -j * ty, -j * tz)
