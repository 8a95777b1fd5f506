"""
The solution in common: sequential impulses, eight pairs at a time.

A sweep visits block after block, in each the first points of all its pairs, then the second ones.
The pairs of a block share no body that moves, so the eight are independent, and one stream of
vector instructions does all; each number is rounded as if it were alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.layout import (
    ACTED,
    ARM,
    BODY_A,
    BODY_B,
    BOUNCE,
    COUNT,
    CROSS,
    FASTEST,
    FIRST_GAP,
    FIRST_WAY,
    FRICTION,
    GAP,
    HALF,
    HITS,
    INERTIA_A,
    INERTIA_B,
    JN,
    JT,
    LANES,
    MASS_A,
    MASS_B,
    MASS_N,
    MASS_T,
    POINT,
    POINT_SIZE,
    SETTLED,
    SHIFT,
    TARGET,
    TOTAL,
    WAY,
    WORK_A,
    WORK_B,
    N,
    V,
    X,
    Y,
    Z,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# In sides: the overlap that is left alone. The rest goes with the rate PUSH_OUT, 1/s, no faster
# than FASTEST_PUSH, m/s; the velocity of that is taken away again (relaxation). Ten times the
# rate makes stacks tremble: what one sweep leaves of it feeds the next.
SLOP, PUSH_OUT, FASTEST_PUSH = 4e-5, 15.0, 2.0
# A target that no velocity misses: the point is left alone.
ANYTHING = -1e300

# Columns of the work: linear and angular part of either body.
AV, AW = WORK_A, WORK_A + 3 * LANES
BV, BW = WORK_B, WORK_B + 3 * LANES


@compiled
def cross(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float, float]:
    """Return the vector product a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@compiled
def take(bodies: Floats, lane: Integers, first: int, work: Floats) -> None:
    """Fetch six columns of both bodies of each pair, from column `first` on."""
    for i in range(LANES):
        a = bodies[lane[BODY_A + i]]
        b = bodies[lane[BODY_B + i]]
        for n in range(6):
            work[WORK_A + n * LANES + i] = a[first + n]
            work[WORK_B + n * LANES + i] = b[first + n]


@compiled
def give(bodies: Floats, lane: Integers, work: Floats) -> None:
    """Put the velocities back. What nothing moves gets the zeros that it gave."""
    for i in range(LANES):
        a = bodies[lane[BODY_A + i]]
        b = bodies[lane[BODY_B + i]]
        for n in range(6):
            a[V + n] = work[WORK_A + n * LANES + i]
            b[V + n] = work[WORK_B + n * LANES + i]


@compiled
def visit(block: Floats, point: Floats, work: Floats, enough: float) -> int:
    """
    Give one point of each pair its law; return how many changed by more than `enough`, N s.

    The normal velocity becomes TARGET at least, by a normal impulse that is not negative in all;
    then the tangential impulse, a vector, takes the sliding away as far as FRICTION times the
    normal one goes. CROSS is what the normal part does to the sliding.
    """
    unsettled = 0
    for i in range(LANES):
        nx, ny, nz = block[N + X + i], block[N + Y + i], block[N + Z + i]
        ax = point[ARM + X + i] + block[HALF + X + i]
        ay = point[ARM + Y + i] + block[HALF + Y + i]
        az = point[ARM + Z + i] + block[HALF + Z + i]
        bx = ax - block[WAY + X + i]
        by = ay - block[WAY + Y + i]
        bz = az - block[WAY + Z + i]
        px, py, pz = cross(work[AW + X + i], work[AW + Y + i], work[AW + Z + i], ax, ay, az)
        qx, qy, qz = cross(work[BW + X + i], work[BW + Y + i], work[BW + Z + i], bx, by, bz)
        ux = (work[BV + X + i] - work[AV + X + i]) + (qx - px)
        uy = (work[BV + Y + i] - work[AV + Y + i]) + (qy - py)
        uz = (work[BV + Z + i] - work[AV + Z + i]) + (qz - pz)
        un = (ux * nx + uy * ny) + uz * nz
        old = point[JN + i]
        new = max(old + point[MASS_N + i] * (point[TARGET + i] - un), 0.0)
        change = new - old
        unsettled += abs(change) > enough
        tx, ty, tz = point[JT + X + i], point[JT + Y + i], point[JT + Z + i]
        mass = point[MASS_T + i]
        fx = tx - mass * ((ux - un * nx) + change * point[CROSS + X + i])
        fy = ty - mass * ((uy - un * ny) + change * point[CROSS + Y + i])
        fz = tz - mass * ((uz - un * nz) + change * point[CROSS + Z + i])
        length = (fx * fx + fy * fy) + fz * fz
        limit = block[FRICTION + i] * new
        scale = limit / math.sqrt(length) if length > limit * limit else 1.0
        fx, fy, fz = fx * scale, fy * scale, fz * scale
        point[JN + i] = new
        point[JT + X + i] = fx
        point[JT + Y + i] = fy
        point[JT + Z + i] = fz
        block[ACTED + i] += new
        jx, jy, jz = change * nx + (fx - tx), change * ny + (fy - ty), change * nz + (fz - tz)
        mass_a, mass_b = block[MASS_A + i], block[MASS_B + i]
        inertia_a, inertia_b = block[INERTIA_A + i], block[INERTIA_B + i]
        px, py, pz = cross(ax, ay, az, jx, jy, jz)
        qx, qy, qz = cross(bx, by, bz, jx, jy, jz)
        work[AV + X + i] -= mass_a * jx
        work[AV + Y + i] -= mass_a * jy
        work[AV + Z + i] -= mass_a * jz
        work[AW + X + i] -= inertia_a * px
        work[AW + Y + i] -= inertia_a * py
        work[AW + Z + i] -= inertia_a * pz
        work[BV + X + i] += mass_b * jx
        work[BV + Y + i] += mass_b * jy
        work[BV + Z + i] += mass_b * jz
        work[BW + X + i] += inertia_b * qx
        work[BW + Y + i] += inertia_b * qy
        work[BW + Z + i] += inertia_b * qz
    return unsettled


@compiled
def sweep(
    blocks: Floats,
    lanes: Integers,
    bodies: Floats,
    work: Floats,
    first: int,
    last: int,
    backward: bool,
    enough: float,
    all_of_them: bool,
) -> int:
    """
    Visit the points of the blocks `first` to `last` - 1, of those that are not SETTLED or of all.

    Return how many points changed by more than `enough`, N s; a block without any is settled.
    """
    total = 0
    for m in range(last - first):
        # To and fro, so that what a cube learns of its load goes up and down a stack.
        k = last - 1 - m if backward else first + m
        lane = lanes[k]
        if lane[SETTLED] and not all_of_them:
            continue
        block = blocks[k]
        take(bodies, lane, V, work)
        unsettled = 0
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            unsettled += visit(block, block[start : start + POINT_SIZE], work, enough)
        give(bodies, lane, work)
        lane[SETTLED] = 0 if unsettled else 1
        total += unsettled
    return total


@compiled
def push(block: Floats, point: Floats, work: Floats) -> None:
    """Apply the impulses of one point of each pair; the tangential part is made so again."""
    for i in range(LANES):
        nx, ny, nz = block[N + X + i], block[N + Y + i], block[N + Z + i]
        ax = point[ARM + X + i] + block[HALF + X + i]
        ay = point[ARM + Y + i] + block[HALF + Y + i]
        az = point[ARM + Z + i] + block[HALF + Z + i]
        bx = ax - block[WAY + X + i]
        by = ay - block[WAY + Y + i]
        bz = az - block[WAY + Z + i]
        jx, jy, jz = point[JT + X + i], point[JT + Y + i], point[JT + Z + i]
        # What the normal has turned since then is no longer tangential.
        along = (jx * nx + jy * ny) + jz * nz
        jx, jy, jz = jx - along * nx, jy - along * ny, jz - along * nz
        point[JT + X + i] = jx
        point[JT + Y + i] = jy
        point[JT + Z + i] = jz
        jn = point[JN + i]
        jx, jy, jz = jx + jn * nx, jy + jn * ny, jz + jn * nz
        mass_a, mass_b = block[MASS_A + i], block[MASS_B + i]
        inertia_a, inertia_b = block[INERTIA_A + i], block[INERTIA_B + i]
        px, py, pz = cross(ax, ay, az, jx, jy, jz)
        qx, qy, qz = cross(bx, by, bz, jx, jy, jz)
        work[AV + X + i] -= mass_a * jx
        work[AV + Y + i] -= mass_a * jy
        work[AV + Z + i] -= mass_a * jz
        work[AW + X + i] -= inertia_a * px
        work[AW + Y + i] -= inertia_a * py
        work[AW + Z + i] -= inertia_a * pz
        work[BV + X + i] += mass_b * jx
        work[BV + Y + i] += mass_b * jy
        work[BV + Z + i] += mass_b * jz
        work[BW + X + i] += inertia_b * qx
        work[BW + Y + i] += inertia_b * qy
        work[BW + Z + i] += inertia_b * qz


@compiled
def start_from_last(
    blocks: Floats, lanes: Integers, bodies: Floats, work: Floats, count: int
) -> None:
    """Apply the impulses of the last sub-step."""
    for k in range(count):
        block, lane = blocks[k], lanes[k]
        take(bodies, lane, V, work)
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            push(block, block[start : start + POINT_SIZE], work)
        give(bodies, lane, work)


@compiled
def move_along(blocks: Floats, lanes: Integers, bodies: Floats, work: Floats, count: int) -> None:
    """Bring centres and gaps up to date with how the bodies have moved."""
    for k in range(count):
        block, lane = blocks[k], lanes[k]
        take(bodies, lane, SHIFT, work)
        for i in range(LANES):
            for c in range(0, 3 * LANES, LANES):
                shift = work[BV + c + i] - work[AV + c + i]
                block[HALF + c + i] = 0.5 * shift
                block[WAY + c + i] = block[FIRST_WAY + c + i] + shift
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            open_gaps(block, block[start : start + POINT_SIZE], work)


@compiled
def open_gaps(block: Floats, point: Floats, work: Floats) -> None:
    """Write the present gap of one point of each pair; turns count to the first order."""
    for i in range(LANES):
        ax, ay, az = point[ARM + X + i], point[ARM + Y + i], point[ARM + Z + i]
        bx = ax - block[FIRST_WAY + X + i]
        by = ay - block[FIRST_WAY + Y + i]
        bz = az - block[FIRST_WAY + Z + i]
        px, py, pz = cross(work[AW + X + i], work[AW + Y + i], work[AW + Z + i], ax, ay, az)
        qx, qy, qz = cross(work[BW + X + i], work[BW + Y + i], work[BW + Z + i], bx, by, bz)
        ox = 2.0 * block[HALF + X + i] + (qx - px)
        oy = 2.0 * block[HALF + Y + i] + (qy - py)
        oz = 2.0 * block[HALF + Z + i] + (qz - pz)
        point[GAP + i] = point[FIRST_GAP + i] + (
            (ox * block[N + X + i] + oy * block[N + Y + i]) + oz * block[N + Z + i]
        )


@compiled
def aim(
    blocks: Floats, lanes: Integers, count: int, time: float, slop: float, pushing: bool
) -> None:
    """
    Write the TARGET of every point.

    At least -gap/time where there is a gap. Where there is overlap, a velocity that takes it away
    if `pushing`, else 0; and what may hit in the next sub-step is then left to it.
    """
    per_time = 1.0 / time
    rate = min(PUSH_OUT, 0.2 * per_time) if pushing else 0.0
    for k in range(count):
        block, lane = blocks[k], lanes[k]
        lane[SETTLED] = 0
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            point = block[start : start + POINT_SIZE]
            for i in range(LANES):
                gap = point[GAP + i]
                out = max(min(-(rate * (gap + slop)), FASTEST_PUSH), 0.0)
                reach = -(gap * per_time)
                if not pushing and point[JN + i] == 0.0:
                    reach = ANYTHING
                point[TARGET + i] = reach if gap > 0.0 else out


@compiled
def find_hits(
    blocks: Floats,
    lanes: Integers,
    bodies: Floats,
    work: Floats,
    count: int,
    time: float,
    slop: float,
    threshold: float,
    restitution: float,
) -> int:
    """
    Mark the pairs of which a point hits in this sub-step; return how many there are.

    Of these the points that touch take part, with BOUNCE. A point that carries already does
    not hit: what its normal velocity lacks to zero is the error of an unfinished solution, and
    given back with restitution it would keep a stack trembling.
    """
    found = 0
    for k in range(count):
        block, lane = blocks[k], lanes[k]
        fastest = 0.0
        for i in range(LANES):
            block[HITS + i] = 0.0
            speed = bodies[lane[BODY_A + i], FASTEST] + bodies[lane[BODY_B + i], FASTEST]
            fastest = max(fastest, speed)
        if fastest <= threshold:
            continue
        take(bodies, lane, V, work)
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            find_hit(
                block,
                block[start : start + POINT_SIZE],
                work,
                time,
                slop,
                threshold,
                restitution,
            )
        hits = 0
        for i in range(LANES):
            hits += block[HITS + i] > 0.0
        found += hits
    return found


@compiled
def find_hit(
    block: Floats,
    point: Floats,
    work: Floats,
    time: float,
    slop: float,
    threshold: float,
    restitution: float,
) -> None:
    """Do so for one point of each pair."""
    for i in range(LANES):
        ax = point[ARM + X + i] + block[HALF + X + i]
        ay = point[ARM + Y + i] + block[HALF + Y + i]
        az = point[ARM + Z + i] + block[HALF + Z + i]
        bx = ax - block[WAY + X + i]
        by = ay - block[WAY + Y + i]
        bz = az - block[WAY + Z + i]
        px, py, pz = cross(work[AW + X + i], work[AW + Y + i], work[AW + Z + i], ax, ay, az)
        qx, qy, qz = cross(work[BW + X + i], work[BW + Y + i], work[BW + Z + i], bx, by, bz)
        ux = (work[BV + X + i] - work[AV + X + i]) + (qx - px)
        uy = (work[BV + Y + i] - work[AV + Y + i]) + (qy - py)
        uz = (work[BV + Z + i] - work[AV + Z + i]) + (qz - pz)
        un = (ux * block[N + X + i] + uy * block[N + Y + i]) + uz * block[N + Z + i]
        gap = point[GAP + i]
        carries = point[JN + i] > 0.0
        hits = (un < -threshold) & (gap + time * un <= 0.0) & (not carries)
        held = carries | ((un < threshold) & (gap <= slop))
        bounce = -(restitution * un) if hits else (0.0 if held else -1.0)
        point[BOUNCE + i] = bounce
        block[HITS + i] = max(block[HITS + i], -un) if hits else block[HITS + i]


@compiled
def add_up(blocks: Floats, lanes: Integers, count: int) -> None:
    """Add the impulses of a sub-step to the totals of the step."""
    for k in range(count):
        block = blocks[k]
        for p in range(lanes[k, COUNT]):
            start = POINT + p * POINT_SIZE
            point = block[start : start + POINT_SIZE]
            for i in range(LANES):
                jn = point[JN + i]
                for c in range(0, 3 * LANES, LANES):
                    point[TOTAL + c + i] += jn * block[N + c + i] + point[JT + c + i]
