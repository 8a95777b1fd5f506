"""The step of a cube that no other cube is near: flight, impacts and support, event by event."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.corners import (
    HEIGHT,
    JN,
    JX,
    JY,
    PART,
    QW,
    QX,
    QY,
    QZ,
    SPEED,
    TARGET,
    VX,
    VY,
    VZ,
    WX,
    WY,
    WZ,
    X,
    Y,
    Z,
    apply_impulse,
    bounce,
    place_corners,
    solve_corners,
)
from cube_sim.physics.contact.layout import FORCE, PUSH
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.rotation import composed, rotor

Floats = NDArray[np.float64]

# In sides: a corner lower than this touches; a flight ends this close above the plane.
TOUCH, ARRIVAL = 1e-7, 1e-10
# Impacts of one step; the later ones are inelastic, which ends every series.
# A share of the speed of one step's fall: below it a corner is at rest.
SLIGHT = 1e-6
MOST_EVENTS = 24
MOST_BOUNCES = 16
# Parts of a flight: each ends at the plane or where no corner can have reached it before.
MOST_PARTS = 64
MOST_SWEEPS = 100

NOTHING, TOUCHED, AT_REST = 0, 1, 2

# Rows of the scratch: the corners, the cube, and its copies.
CORNER_ROWS, SPARE, BEFORE, FUTURE, END = 8, 9, 10, 11, 12


@compiled
def moved(
    cube: Floats,
    ax: float,
    ay: float,
    az: float,
    tx: float,
    ty: float,
    tz: float,
    t: float,
    target: Floats,
) -> None:
    """
    Write to `target` where a cube is after a time t, s.

    (ax, ay, az) is its constant acceleration, (tx, ty, tz) its constant angular acceleration;
    it turns about its mean spin, which is exact where the spin keeps its direction.
    """
    half = 0.5 * t
    x, y, z, w = rotor(cube[WX] + half * tx, cube[WY] + half * ty, cube[WZ] + half * tz, t)
    x, y, z, w = composed(x, y, z, w, cube[QX], cube[QY], cube[QZ], cube[QW])
    scale = 1.0 / math.sqrt((x * x + y * y) + (z * z + w * w))
    target[X] = cube[X] + t * (cube[VX] + half * ax)
    target[Y] = cube[Y] + t * (cube[VY] + half * ay)
    target[Z] = cube[Z] + t * (cube[VZ] + half * az)
    target[QX] = x * scale
    target[QY] = y * scale
    target[QZ] = z * scale
    target[QW] = w * scale
    target[VX] = cube[VX] + t * ax
    target[VY] = cube[VY] + t * ay
    target[VZ] = cube[VZ] + t * az
    target[WX] = cube[WX] + t * tx
    target[WY] = cube[WY] + t * ty
    target[WZ] = cube[WZ] + t * tz


@compiled
def fly(cube: Floats, rules: Rules, left: float, scratch: Floats) -> float:
    """
    Fly until a corner meets the plane, at most for `left`, s; return the time flown.

    No corner is accelerated by more than most = |g_z| + |w|^2 |r|, so one at height h with the
    normal velocity u stays above the plane for as long as h + u t - most t^2/2 >= 0. The least
    such time of all corners is a safe step, and near the plane these steps are Newton's.
    """
    corners, start = scratch[:CORNER_ROWS], scratch[FUTURE]
    half_side = rules.half_side
    reach = half_side * 1.7320508075688774
    spin = (cube[WX] * cube[WX] + cube[WY] * cube[WY]) + cube[WZ] * cube[WZ]
    most = abs(rules.gz) + spin * reach
    arrival = ARRIVAL * half_side
    for n in range(13):
        start[n] = cube[n]
    flown = 0.0
    for part in range(MOST_PARTS):
        place_corners(cube, half_side, corners)
        safe = left - flown
        arrived = False
        for k in range(8):
            height, speed = max(corners[k, HEIGHT], 0.0), corners[k, SPEED]
            if height <= arrival and speed <= 0.0 and part > 0:
                arrived = True
            elif most > 0.0:
                time = (speed + math.sqrt(speed * speed + 2.0 * most * height)) / most
                if speed < 0.0:
                    # The same without cancellation.
                    time = 2.0 * height / (math.sqrt(speed * speed + 2.0 * most * height) - speed)
                safe = min(safe, time)
            elif speed < 0.0:
                safe = min(safe, -(height / speed))
        if arrived:
            return flown
        if flown + safe >= left:
            moved(start, rules.gx, rules.gy, rules.gz, 0.0, 0.0, 0.0, left, cube)
            return left
        flown += safe
        moved(start, rules.gx, rules.gy, rules.gz, 0.0, 0.0, 0.0, flown, cube)
    return flown


@compiled
def support(cube: Floats, memory: Floats, rules: Rules, left: float, scratch: Floats) -> float:
    """
    Let the plane carry a cube on its touching corners for up to `left`, s; return for how long.

    0.0 when it needs no carrying. The forces are those that leave velocities which obey the laws of
    contact at the end, without restitution. Ends early where another corner comes down.
    """
    corners, old, end = scratch[:CORNER_ROWS], scratch[BEFORE], scratch[END]
    w, half_side = rules.inverse_inertia, rules.half_side
    touch = 2.0 * TOUCH * half_side
    fall = rules.gravity * left
    slow = fall + rules.threshold
    for n in range(13):
        old[n] = cube[n]
    cube[VX] += rules.gx * left
    cube[VY] += rules.gy * left
    cube[VZ] += rules.gz * left
    for k in range(8):
        corner = corners[k]
        corner[PART] = 0.0
        near = corner[HEIGHT] <= touch
        # One that is about to touch is let down to it, instead of a small impact.
        if not near and corner[HEIGHT] <= slow * left:
            near = abs(corner[SPEED]) <= rules.threshold
        if near:
            corner[PART] = 1.0
            corner[TARGET] = -(max(corner[HEIGHT], 0.0) / left)
        for n in range(3):
            corner[JX + n] = memory[FORCE + 3 * k + n] * left if near else 0.0
        if near:
            apply_impulse(cube, w, corner, corner[JX], corner[JY], corner[JN])
    speed = (abs(cube[VX]) + abs(cube[VY])) + abs(cube[VZ])
    tolerance = 1e-7 * fall + 1e-15 * speed
    solve_corners(cube, rules, rules.friction, corners, tolerance, MOST_SWEEPS)
    carried = 0.0
    for k in range(8):
        if corners[k, PART] > 0.0:
            carried = max(carried, corners[k, JN])
    if carried == 0.0:
        for n in range(VX, WZ + 1):
            cube[n] = old[n]
        return 0.0

    # Stillness is a velocity of zero, not one of rounding.
    still = SLIGHT * fall
    moving = (abs(cube[VX]) + abs(cube[VY])) + abs(cube[VZ])
    turning = (abs(cube[WX]) + abs(cube[WY])) + abs(cube[WZ])
    if moving < still and turning * half_side < still:
        for n in range(VX, WZ + 1):
            cube[n] = 0.0
    for k in range(8):
        for n in range(3):
            memory[FORCE + 3 * k + n] = corners[k, JX + n] / left

    # Upright and in its turn the cube moves as the contact allows at the end, or a corner that
    # came slowly off the plane would be lifted before it is held; along the plane by the mean,
    # which is exact for a constant friction.
    ax = (cube[VX] - old[VX]) / left
    ay = (cube[VY] - old[VY]) / left
    start = scratch[FUTURE]
    for n in range(13):
        start[n] = cube[n] if n >= VZ else old[n]
    used = left
    moved(start, ax, ay, 0.0, 0.0, 0.0, 0.0, left, end)
    if lowest_free_corner(end, half_side, corners) < -touch:
        used = arrival_time(start, ax, ay, left, half_side, corners, end)
        moved(start, ax, ay, 0.0, 0.0, 0.0, 0.0, used, end)
        for n in range(VX, WZ + 1):
            end[n] = old[n] + (used / left) * (cube[n] - old[n])
    else:
        # To the bit what was solved.
        for n in range(VX, WZ + 1):
            end[n] = cube[n]
    share = used / left
    for k in range(8):
        for n in range(3):
            memory[PUSH + 3 * k + n] += share * corners[k, JX + n]
    for n in range(13):
        cube[n] = end[n]
    return used


@compiled
def lowest_free_corner(cube: Floats, half_side: float, corners: Floats) -> float:
    """Return the height of the lowest corner that takes no part in the support, m."""
    x, y, z, w = cube[QX], cube[QY], cube[QZ], cube[QW]
    az = half_side * (2.0 * (x * z - y * w))
    bz = half_side * (2.0 * (y * z + x * w))
    cz = half_side * (1.0 - 2.0 * (x * x + y * y))
    lowest = 1e300
    for k in range(8):
        if corners[k, PART] == 0.0:
            i = az if k & 1 else -az
            j = bz if k & 2 else -bz
            m = cz if k & 4 else -cz
            lowest = min(lowest, cube[Z] + ((i + j) + m))
    return lowest


@compiled
def arrival_time(
    start: Floats,
    ax: float,
    ay: float,
    left: float,
    half_side: float,
    corners: Floats,
    end: Floats,
) -> float:
    """Return when a free corner comes down to the plane, before `left`, s, by bisection."""
    low, high = 0.0, left
    for _ in range(40):
        middle = 0.5 * (low + high)
        moved(start, ax, ay, 0.0, 0.0, 0.0, 0.0, middle, end)
        height = lowest_free_corner(end, half_side, corners)
        if height < 0.0:
            high = middle
        else:
            low = middle
            if height <= 0.5 * TOUCH * half_side:
                break
    return high if low == 0.0 else low


@compiled
def step_alone(cube: Floats, memory: Floats, rules: Rules, scratch: Floats) -> int:
    """
    Advance one cube (13,) by a step; return NOTHING, TOUCHED or AT_REST (nothing has changed).

    `memory` is its row of `cubes`: the forces to start from, and the impulses that it got.
    """
    corners = scratch[:CORNER_ROWS]
    half_side = rules.half_side
    left = rules.time_step
    reach = half_side * 1.7320508075688774
    sink = abs(cube[VZ]) * left + abs(rules.gz) * left * left
    if cube[Z] - sink > reach:
        place = scratch[FUTURE]
        for n in range(13):
            place[n] = cube[n]
        moved(place, rules.gx, rules.gy, rules.gz, 0.0, 0.0, 0.0, left, cube)
        return NOTHING
    for n in range(24):
        memory[PUSH + n] = 0.0
    touch = TOUCH * half_side
    still = True
    for n in range(VX, WZ + 1):
        still = still and cube[n] == 0.0
    result = NOTHING
    for event in range(MOST_EVENTS):
        lowest = place_corners(cube, half_side, corners)
        if lowest < -1e-12 * half_side:
            cube[Z] -= lowest
            still = False
            for k in range(8):
                corners[k, HEIGHT] -= lowest
        approach = 0.0
        slowest = 1e300
        for k in range(8):
            if corners[k, HEIGHT] <= touch:
                approach = max(approach, -corners[k, SPEED])
                slowest = min(slowest, corners[k, SPEED])
        if approach > rules.threshold and event < MOST_BOUNCES:
            bounce(cube, rules, corners, touch, scratch[SPARE])
            for k in range(8):
                if corners[k, PART] > 0.0:
                    for n in range(3):
                        memory[PUSH + 3 * k + n] += corners[k, JX + n]
            result = TOUCHED
            continue
        if slowest < rules.threshold + rules.gravity * left:
            used = support(cube, memory, rules, left, scratch)
            if used > 0.0:
                result = TOUCHED
                left -= used
                if left <= 0.0:
                    break
                continue
        left -= fly(cube, rules, left, scratch)
        if left <= 0.0:
            break
    if result == TOUCHED and still:
        unmoved = True
        for n in range(VX, WZ + 1):
            unmoved = unmoved and cube[n] == 0.0
        if unmoved:
            return AT_REST
    return result
