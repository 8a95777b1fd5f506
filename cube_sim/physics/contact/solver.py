"""The solution in common: sub-steps of sequential impulses for all cubes that touch each other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.layout import (
    ACTIVE,
    ARM_A,
    ARM_B,
    ASLEEP,
    BOUNCE,
    GAP,
    GROUPED,
    HIT,
    HITTING,
    IMPULSE_N,
    IMPULSE_T,
    INVERSE_INERTIA,
    INVERSE_MASS,
    KEPT,
    MASS_N,
    MASS_T,
    NORMAL,
    POINT,
    POINT_COLUMNS,
    POINTS,
    SHIFT,
    SV,
    SW,
    TOTAL,
    TOUCHED,
    TURN,
)
from cube_sim.physics.contact.rules import Rules

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# In sides: the overlap that is left alone. The rest goes with the rate PUSH_OUT, 1/s, no faster
# than FASTEST_PUSH, m/s; the velocity of that is taken away again (relaxation). Ten times the
# rate makes stacks tremble: what one sweep leaves of it feeds the next.
SLOP, PUSH_OUT, FASTEST_PUSH = 4e-5, 15.0, 2.0
MOST_SWEEPS, MOST_ATTEMPTS = 80, 4

WARM, PUSHING, RELAXING, BOUNCING = 0, 1, 2, 3


@compiled
def sweep(
    cubes: Floats,
    pairs: Floats,
    ends: Integers,
    active: int,
    rules: Rules,
    time: float,
    kind: int,
    backward: bool,
) -> float:
    """
    Visit every point once; return the greatest change of a normal impulse, N s.

    WARM applies the impulses of the last sub-step. PUSHING and RELAXING ask for a normal
    velocity of at least -gap/time where there is a gap; where there is overlap, PUSHING asks for
    one that takes it away and RELAXING for 0. BOUNCING visits the points of an impact and asks for
    BOUNCE. The impulse of a point stays in Coulomb's cone: after the normal part the tangential
    one, a vector, is shortened to friction times the normal one.
    """
    slop = SLOP * 2.0 * rules.half_side
    per_time = 1.0 / time
    rate = min(PUSH_OUT, 0.2 * per_time)
    greatest = 0.0
    for m in range(active):
        # To and fro, so that what a cube learns of its load goes up and down a stack.
        n = active - 1 - m if backward else m
        number, a, b = ends[n, ACTIVE], ends[n, ACTIVE + 1], ends[n, ACTIVE + 2]
        points = ends[number, POINTS]
        if kind == BOUNCING and not ends[number, HITTING]:
            continue
        nx = pairs[number, NORMAL]
        ny = pairs[number, NORMAL + 1]
        nz = pairs[number, NORMAL + 2]
        mass_a, mass_b = cubes[a, INVERSE_MASS], cubes[b, INVERSE_MASS]
        inertia_a, inertia_b = cubes[a, INVERSE_INERTIA], cubes[b, INVERSE_INERTIA]
        avx, avy, avz = cubes[a, SV], cubes[a, SV + 1], cubes[a, SV + 2]
        awx, awy, awz = cubes[a, SW], cubes[a, SW + 1], cubes[a, SW + 2]
        bvx, bvy, bvz = cubes[b, SV], cubes[b, SV + 1], cubes[b, SV + 2]
        bwx, bwy, bwz = cubes[b, SW], cubes[b, SW + 1], cubes[b, SW + 2]
        # Half of how the centres have moved against each other: the shared point lies between.
        sx = 0.5 * (cubes[b, SHIFT] - cubes[a, SHIFT])
        sy = 0.5 * (cubes[b, SHIFT + 1] - cubes[a, SHIFT + 1])
        sz = 0.5 * (cubes[b, SHIFT + 2] - cubes[a, SHIFT + 2])
        for p in range(points):
            at = POINT + p * POINT_COLUMNS
            if kind == BOUNCING and pairs[number, at + BOUNCE] < 0.0:
                continue
            ax0 = pairs[number, at + ARM_A]
            ay0 = pairs[number, at + ARM_A + 1]
            az0 = pairs[number, at + ARM_A + 2]
            bx0 = pairs[number, at + ARM_B]
            by0 = pairs[number, at + ARM_B + 1]
            bz0 = pairs[number, at + ARM_B + 2]
            ax, ay, az = ax0 + sx, ay0 + sy, az0 + sz
            bx, by, bz = bx0 - sx, by0 - sy, bz0 - sz
            if kind == WARM:
                old_n = 0.0
                new_n = pairs[number, at + IMPULSE_N]
                jx = pairs[number, at + IMPULSE_T]
                jy = pairs[number, at + IMPULSE_T + 1]
                jz = pairs[number, at + IMPULSE_T + 2]
                # What the normal has turned since then is no longer tangential.
                along = (jx * nx + jy * ny) + jz * nz
                jx, jy, jz = jx - along * nx, jy - along * ny, jz - along * nz
                pairs[number, at + IMPULSE_T] = jx
                pairs[number, at + IMPULSE_T + 1] = jy
                pairs[number, at + IMPULSE_T + 2] = jz
                jx, jy, jz = jx + new_n * nx, jy + new_n * ny, jz + new_n * nz
            else:
                ux = (bvx - avx) + ((bwy * bz - bwz * by) - (awy * az - awz * ay))
                uy = (bvy - avy) + ((bwz * bx - bwx * bz) - (awz * ax - awx * az))
                uz = (bvz - avz) + ((bwx * by - bwy * bx) - (awx * ay - awy * ax))
                un = (ux * nx + uy * ny) + uz * nz
                if kind == BOUNCING:
                    old_n = pairs[number, at + HIT]
                    target = pairs[number, at + BOUNCE]
                else:
                    old_n = pairs[number, at + IMPULSE_N]
                    # By how much the two have come apart since the collision phase.
                    tax, tay, taz = cubes[a, TURN], cubes[a, TURN + 1], cubes[a, TURN + 2]
                    tbx, tby, tbz = cubes[b, TURN], cubes[b, TURN + 1], cubes[b, TURN + 2]
                    ox = 2.0 * sx + ((tby * bz0 - tbz * by0) - (tay * az0 - taz * ay0))
                    oy = 2.0 * sy + ((tbz * bx0 - tbx * bz0) - (taz * ax0 - tax * az0))
                    oz = 2.0 * sz + ((tbx * by0 - tby * bx0) - (tax * ay0 - tay * ax0))
                    gap = pairs[number, at + GAP] + ((ox * nx + oy * ny) + oz * nz)
                    target = 0.0
                    if gap > 0.0:
                        # What may hit in the next sub-step is left to it, with restitution.
                        if kind == RELAXING and old_n == 0.0:
                            continue
                        target = -(gap * per_time)
                    elif kind == PUSHING and gap < -slop:
                        target = min(-(rate * (gap + slop)), FASTEST_PUSH)
                new_n = max(old_n + pairs[number, at + MASS_N] * (target - un), 0.0)
                if new_n == 0.0 and old_n == 0.0:
                    continue
                change = new_n - old_n
                greatest = max(greatest, abs(change))
                # The tangential velocity after the normal impulse.
                jx, jy, jz = change * nx, change * ny, change * nz
                awx2 = awx - inertia_a * (ay * jz - az * jy)
                awy2 = awy - inertia_a * (az * jx - ax * jz)
                awz2 = awz - inertia_a * (ax * jy - ay * jx)
                bwx2 = bwx + inertia_b * (by * jz - bz * jy)
                bwy2 = bwy + inertia_b * (bz * jx - bx * jz)
                bwz2 = bwz + inertia_b * (bx * jy - by * jx)
                mass = mass_a + mass_b
                ux = ((bvx - avx) + mass * jx) + ((bwy2 * bz - bwz2 * by) - (awy2 * az - awz2 * ay))
                uy = ((bvy - avy) + mass * jy) + ((bwz2 * bx - bwx2 * bz) - (awz2 * ax - awx2 * az))
                uz = ((bvz - avz) + mass * jz) + ((bwx2 * by - bwy2 * bx) - (awx2 * ay - awy2 * ax))
                un = (ux * nx + uy * ny) + uz * nz
                mt = pairs[number, at + MASS_T]
                tx = pairs[number, at + IMPULSE_T]
                ty = pairs[number, at + IMPULSE_T + 1]
                tz = pairs[number, at + IMPULSE_T + 2]
                fx = tx - mt * (ux - un * nx)
                fy = ty - mt * (uy - un * ny)
                fz = tz - mt * (uz - un * nz)
                length = (fx * fx + fy * fy) + fz * fz
                limit = rules.friction * new_n
                if length > limit * limit:
                    scale = limit / math.sqrt(length)
                    fx, fy, fz = fx * scale, fy * scale, fz * scale
                pairs[number, at + IMPULSE_T] = fx
                pairs[number, at + IMPULSE_T + 1] = fy
                pairs[number, at + IMPULSE_T + 2] = fz
                if kind == BOUNCING:
                    pairs[number, at + HIT] = new_n
                else:
                    pairs[number, at + IMPULSE_N] = new_n
                jx, jy, jz = jx + (fx - tx), jy + (fy - ty), jz + (fz - tz)
            avx, avy, avz = avx - mass_a * jx, avy - mass_a * jy, avz - mass_a * jz
            awx -= inertia_a * (ay * jz - az * jy)
            awy -= inertia_a * (az * jx - ax * jz)
            awz -= inertia_a * (ax * jy - ay * jx)
            bvx, bvy, bvz = bvx + mass_b * jx, bvy + mass_b * jy, bvz + mass_b * jz
            bwx += inertia_b * (by * jz - bz * jy)
            bwy += inertia_b * (bz * jx - bx * jz)
            bwz += inertia_b * (bx * jy - by * jx)
        cubes[a, SV], cubes[a, SV + 1], cubes[a, SV + 2] = avx, avy, avz
        cubes[a, SW], cubes[a, SW + 1], cubes[a, SW + 2] = awx, awy, awz
        cubes[b, SV], cubes[b, SV + 1], cubes[b, SV + 2] = bvx, bvy, bvz
        cubes[b, SW], cubes[b, SW + 1], cubes[b, SW + 2] = bwx, bwy, bwz
    return greatest


@compiled
def approach(cubes: Floats, pairs: Floats, number: int, at: int, a: int, b: int) -> float:
    """Return the normal velocity of a point, m/s: negative when the two come nearer."""
    un = 0.0
    for i in range(3):
        j = i + 1 if i < 2 else 0
        k = j + 1 if j < 2 else 0
        s_j = 0.5 * (cubes[b, SHIFT + j] - cubes[a, SHIFT + j])
        s_k = 0.5 * (cubes[b, SHIFT + k] - cubes[a, SHIFT + k])
        ub = cubes[b, SV + i] + (
            cubes[b, SW + j] * (pairs[number, at + ARM_B + k] - s_k)
            - cubes[b, SW + k] * (pairs[number, at + ARM_B + j] - s_j)
        )
        ua = cubes[a, SV + i] + (
            cubes[a, SW + j] * (pairs[number, at + ARM_A + k] + s_k)
            - cubes[a, SW + k] * (pairs[number, at + ARM_A + j] + s_j)
        )
        un += pairs[number, NORMAL + i] * (ub - ua)
    return un


@compiled
def opening(cubes: Floats, pairs: Floats, number: int, at: int, a: int, b: int) -> float:
    """Return the gap of a point now, m."""
    gap: float = pairs[number, at + GAP]
    for i in range(3):
        j = i + 1 if i < 2 else 0
        k = j + 1 if j < 2 else 0
        o = cubes[b, SHIFT + i] - cubes[a, SHIFT + i]
        o += (
            cubes[b, TURN + j] * pairs[number, at + ARM_B + k]
            - cubes[b, TURN + k] * pairs[number, at + ARM_B + j]
        )
        o -= (
            cubes[a, TURN + j] * pairs[number, at + ARM_A + k]
            - cubes[a, TURN + k] * pairs[number, at + ARM_A + j]
        )
        gap += pairs[number, NORMAL + i] * o
    return gap


@compiled
def impacts(
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    active: int,
    rules: Rules,
    count: int,
    time: float,
) -> int:
    """
    Turn back what hits in this sub-step, with restitution and friction; return the sweeps.

    Of a pair with a point that hits, those that touch take part. Gauss-Seidel until the impulses
    stand still: normal and tangential parts come out coupled. A point that carries already does
    not hit: what its normal velocity lacks to zero is the error of an unfinished solution, and
    given back with restitution it would keep a stack trembling. The same goes for speeds that
    gravity gives in two steps.
    """
    threshold = rules.threshold + 2.0 * rules.gravity * rules.time_step
    found = False
    fastest = 0.0
    slop = SLOP * 2.0 * rules.half_side
    for n in range(active):
        number, a, b = ends[n, ACTIVE], ends[n, ACTIVE + 1], ends[n, ACTIVE + 2]
        hits = False
        for p in range(ends[number, POINTS]):
            at = POINT + p * POINT_COLUMNS
            pairs[number, at + BOUNCE] = -1.0
            if pairs[number, at + IMPULSE_N] > 0.0:
                pairs[number, at + BOUNCE] = 0.0
                continue
            un = approach(cubes, pairs, number, at, a, b)
            if un < threshold:
                gap = opening(cubes, pairs, number, at, a, b)
                if un < -threshold and gap + time * un <= 0.0:
                    pairs[number, at + BOUNCE] = -(rules.restitution * un)
                    hits = True
                    fastest = max(fastest, -un)
                elif gap <= slop:
                    pairs[number, at + BOUNCE] = 0.0
        for p in range(ends[number, POINTS]):
            at = POINT + p * POINT_COLUMNS
            if not hits:
                pairs[number, at + BOUNCE] = -1.0
            pairs[number, at + HIT] = 0.0
        ends[number, HITTING] = 1 if hits else 0
        found = found or hits
    if not found:
        return 0
    # The cone is that of the impact alone. Restitution with friction could create energy; where
    # it does, the impacts are solved again with less friction, at last with none.
    before = keep_velocities(cubes, marks, rules, count)
    sweeps = 0
    share = 1.0
    for attempt in range(MOST_ATTEMPTS):
        if attempt == MOST_ATTEMPTS - 1:
            share = 0.0
        set_aside(pairs, ends, active)
        sliding = with_friction(rules, share * rules.friction)
        for n in range(MOST_SWEEPS):
            change = sweep(cubes, pairs, ends, active, sliding, time, BOUNCING, n % 2 == 1)
            sweeps += 1
            if change <= 1e-9 * fastest:
                break
        if kinetic_energy(cubes, marks, rules, count) <= before * (1.0 + 1e-12):
            break
        if attempt < MOST_ATTEMPTS - 1:
            restore_velocities(cubes, marks, count)
        share *= 0.5
    note_impacts(pairs, ends, active, marks)
    return sweeps


@compiled
def with_friction(rules: Rules, friction: float) -> Rules:
    """Return the rules with another friction."""
    return Rules(
        rules.time_step,
        rules.gx,
        rules.gy,
        rules.gz,
        rules.gravity,
        rules.half_side,
        rules.inverse_inertia,
        rules.restitution,
        friction,
        rules.threshold,
        rules.collide,
        rules.sleep,
    )


@compiled
def kinetic_energy(cubes: Floats, marks: Integers, rules: Rules, count: int) -> float:
    """Return the kinetic energy of all cubes of the solution, J."""
    total = 0.0
    for i in range(count):
        if marks[i, GROUPED] and not marks[i, ASLEEP]:
            for n in range(3):
                total += cubes[i, SV + n] * cubes[i, SV + n]
                total += cubes[i, SW + n] * cubes[i, SW + n] / rules.inverse_inertia
    return 0.5 * total


@compiled
def keep_velocities(cubes: Floats, marks: Integers, rules: Rules, count: int) -> float:
    """Remember the velocities of all cubes of the solution; return their energy, J."""
    for i in range(count):
        if marks[i, GROUPED]:
            for n in range(6):
                cubes[i, KEPT + n] = cubes[i, SV + n]
    return kinetic_energy(cubes, marks, rules, count)


@compiled
def restore_velocities(cubes: Floats, marks: Integers, count: int) -> None:
    """Go back to the velocities that were remembered."""
    for i in range(count):
        if marks[i, GROUPED]:
            for n in range(6):
                cubes[i, SV + n] = cubes[i, KEPT + n]


@compiled
def set_aside(pairs: Floats, ends: Integers, active: int) -> None:
    """Let the points of an impact begin without impulses."""
    for n in range(active):
        number = ends[n, ACTIVE]
        for p in range(ends[number, POINTS]):
            at = POINT + p * POINT_COLUMNS
            if pairs[number, at + BOUNCE] >= 0.0:
                pairs[number, at + HIT] = 0.0
                for k in range(3):
                    pairs[number, at + IMPULSE_T + k] = 0.0


@compiled
def note_impacts(pairs: Floats, ends: Integers, active: int, marks: Integers) -> None:
    """Add the impulse of the impact to TOTAL; the points that were hit start their support anew."""
    for n in range(active):
        number = ends[n, ACTIVE]
        for p in range(ends[number, POINTS]):
            at = POINT + p * POINT_COLUMNS
            if pairs[number, at + BOUNCE] >= 0.0:
                for k in range(3):
                    hit = pairs[number, at + HIT] * pairs[number, NORMAL + k]
                    pairs[number, at + TOTAL + k] += hit + pairs[number, at + IMPULSE_T + k]
                    pairs[number, at + IMPULSE_T + k] = 0.0
                if pairs[number, at + HIT] > 0.0:
                    marks[ends[n, ACTIVE + 1], TOUCHED] = 1
                    marks[ends[n, ACTIVE + 2], TOUCHED] = 1


@compiled
def note_touched(marks: Integers, pairs: Floats, ends: Integers, active: int) -> None:
    """Mark the cubes that an impulse has moved, even if the relaxation takes it back."""
    for n in range(active):
        number = ends[n, ACTIVE]
        for p in range(ends[number, POINTS]):
            if pairs[number, POINT + p * POINT_COLUMNS + IMPULSE_N] > 0.0:
                marks[ends[n, ACTIVE + 1], TOUCHED] = 1
                marks[ends[n, ACTIVE + 2], TOUCHED] = 1


@compiled
def add_up(pairs: Floats, ends: Integers, active: int) -> None:
    """Add the impulses of a sub-step to the totals of the step."""
    for n in range(active):
        number = ends[n, ACTIVE]
        for p in range(ends[number, POINTS]):
            at = POINT + p * POINT_COLUMNS
            push = pairs[number, at + IMPULSE_N]
            if push > 0.0:
                for k in range(3):
                    pairs[number, at + TOTAL + k] += (
                        push * pairs[number, NORMAL + k] + pairs[number, at + IMPULSE_T + k]
                    )
