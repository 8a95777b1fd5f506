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

from cube_sim.physics.compiled import compiled, compiled_alone, compiled_inside
from cube_sim.physics.contact.layout import (
    ACTED,
    ARM,
    BODY_A,
    BODY_B,
    BOUNCE,
    CLOSING,
    COUNT,
    CROSS,
    DEEP,
    FASTEST,
    FIRST_GAP,
    FIRST_WAY,
    FRICTION,
    GAP,
    HALF,
    HITS,
    JN,
    JT,
    LANES,
    MASS_N,
    MASS_T,
    MOVED,
    POINT,
    POINT_SIZE,
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
from cube_sim.physics.contact.relative_motion import (
    AV,
    AW,
    BV,
    BW,
    apply_to_both,
    arms_now,
    cross,
    parting,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# In sides: the overlap that is left alone, and the gap at which a point touches all the same.
# Without it a load hangs between touching and not, and stacks sway.
SLOP = 4e-5
# A target that no velocity misses: the point is left alone.
ANYTHING = -1e300


@compiled
def take(bodies: Floats, lane: Integers, first: int, work: Floats) -> None:
    """Fetch six columns of both bodies of each pair, from column `first` on."""
    for i in range(LANES):
        take_one(bodies, lane, first, work, i)


@compiled_inside
def take_one(bodies: Floats, lane: Integers, first: int, work: Floats, i: int) -> None:
    """Do so for pair i."""
    a = bodies[lane[BODY_A + i]]
    b = bodies[lane[BODY_B + i]]
    for n in range(6):
        work[WORK_A + n * LANES + i] = a[first + n]
        work[WORK_B + n * LANES + i] = b[first + n]


@compiled
def give(bodies: Floats, lane: Integers, first: int, work: Floats) -> None:
    """Put the six columns back. What nothing moves gets the zeros that it gave."""
    for i in range(LANES):
        give_one(bodies, lane, first, work, i)


@compiled_inside
def give_one(bodies: Floats, lane: Integers, first: int, work: Floats, i: int) -> None:
    """Do so for pair i."""
    a = bodies[lane[BODY_A + i]]
    b = bodies[lane[BODY_B + i]]
    for n in range(6):
        a[first + n] = work[WORK_A + n * LANES + i]
        b[first + n] = work[WORK_B + n * LANES + i]


@compiled_alone
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
        arms = arms_now(block, point, i)
        ux, uy, uz = parting(work, i, arms)
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
        apply_to_both(block, work, i, arms, jx, jy, jz)
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
) -> int:
    """
    Visit the points of the blocks `first` to `last` - 1.

    Return how many points changed by more than `enough`, N s.
    """
    unsettled = 0
    for m in range(last - first):
        # To and fro, so that what a cube learns of its load goes up and down a stack.
        k = last - 1 - m if backward else first + m
        block, lane = blocks[k], lanes[k]
        take(bodies, lane, V, work)
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            unsettled += visit(block, block[start : start + POINT_SIZE], work, enough)
        give(bodies, lane, V, work)
    return unsettled


@compiled_alone
def push(block: Floats, point: Floats, work: Floats) -> None:
    """Apply the impulses of one point of each pair; the tangential part is made so again."""
    for i in range(LANES):
        nx, ny, nz = block[N + X + i], block[N + Y + i], block[N + Z + i]
        arms = arms_now(block, point, i)
        jx, jy, jz = point[JT + X + i], point[JT + Y + i], point[JT + Z + i]
        # What the normal has turned since then is no longer tangential.
        along = (jx * nx + jy * ny) + jz * nz
        jx, jy, jz = jx - along * nx, jy - along * ny, jz - along * nz
        point[JT + X + i] = jx
        point[JT + Y + i] = jy
        point[JT + Z + i] = jz
        jn = point[JN + i]
        jx, jy, jz = jx + jn * nx, jy + jn * ny, jz + jn * nz
        apply_to_both(block, work, i, arms, jx, jy, jz)


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
        give(bodies, lane, V, work)


@compiled
def move_along(
    blocks: Floats,
    lanes: Integers,
    bodies: Floats,
    work: Floats,
    count: int,
    time: float,
    slop: float,
    counted: float,
) -> None:
    """
    Bring centres, gaps and targets up to date with how the bodies have moved.

    A sub-step takes `time`, s. The impulses of the one that is over are added to the totals,
    `counted` times.
    """
    for k in range(count):
        block, lane = blocks[k], lanes[k]
        take(bodies, lane, SHIFT, work)
        for i in range(LANES):
            for c in range(0, 3 * LANES, LANES):
                shift = work[BV + c + i] - work[AV + c + i]
                block[MOVED + c + i] = 0.5 * shift - block[HALF + c + i]
                block[HALF + c + i] = 0.5 * shift
                block[WAY + c + i] = block[FIRST_WAY + c + i] + shift
        deep = 0
        for p in range(lane[COUNT]):
            start = POINT + p * POINT_SIZE
            point = block[start : start + POINT_SIZE]
            deep += open_gaps(block, point, work, 1.0 / time, slop, counted)
        lane[DEEP] = 1 if deep > 0 else 0


@compiled_alone
def open_gaps(
    block: Floats, point: Floats, work: Floats, per_time: float, slop: float, counted: float
) -> int:
    """
    Do so for one point of each pair; return how many overlap by more than `slop`, m.

    Turns count to the first order. TARGET is zero where the point touches, and lets it come
    down to that where it does not.
    """
    deep = 0
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
        nx, ny, nz = block[N + X + i], block[N + Y + i], block[N + Z + i]
        gap = point[FIRST_GAP + i] + ((ox * nx + oy * ny) + oz * nz)
        deep += gap < -slop
        point[GAP + i] = gap
        point[TARGET + i] = -(max(gap - slop, 0.0) * per_time)
        jn = counted * point[JN + i]
        point[TOTAL + X + i] += jn * nx + counted * point[JT + X + i]
        point[TOTAL + Y + i] += jn * ny + counted * point[JT + Y + i]
        point[TOTAL + Z + i] += jn * nz + counted * point[JT + Z + i]
    return deep


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


@compiled_alone
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
        arms = arms_now(block, point, i)
        ux, uy, uz = parting(work, i, arms)
        un = (ux * block[N + X + i] + uy * block[N + Y + i]) + uz * block[N + Z + i]
        gap = point[GAP + i]
        carries = (point[JN + i] > 0.0) & (gap <= 2.0 * slop)
        # With a margin: what comes nearer than TARGET allows and is no hit would lose its speed.
        fastest = un - max(block[CLOSING + i], 0.0) * time
        hits = (un < -threshold) & (gap - 2.0 * slop + time * fastest <= 0.0) & (not carries)
        held = carries | ((un < threshold) & (gap <= slop))
        # It hits with what it gains on its way through the gap, and shall come as high as if it had
        # left from there: (e^2 (u^2 + 2 a gap) - 2 a gap), as it is turned back here and now.
        lost = 2.0 * (1.0 - restitution * restitution)
        square = (restitution * un) * (restitution * un)
        square -= lost * (block[CLOSING + i] * max(gap, 0.0))
        speed = math.sqrt(max(square, 0.0))
        bounce = speed if hits else (0.0 if held else -1.0)
        point[BOUNCE + i] = bounce
        block[HITS + i] = max(block[HITS + i], -un) if hits else block[HITS + i]
