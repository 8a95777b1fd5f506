"""The corners of one cube at the plane, and the impulses that hold or turn back several at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.cone import cone_impulse
from cube_sim.physics.contact.rules import Rules

Floats = NDArray[np.float64]

# A cube on its own: the 13 components of its state, in the order of the rows of the state.
X, Y, Z, QX, QY, QZ, QW, VX, VY, VZ, WX, WY, WZ = range(13)

# A corner: from the centre to it, m, world; height, m; normal velocity, m/s; the normal velocity
# that it shall have at least; whether it takes part; its impulse so far, N s.
RX, RY, RZ, HEIGHT, SPEED, TARGET, PART, JX, JY, JN = range(10)


@compiled
def place_corners(cube: Floats, half_side: float, corners: Floats) -> float:
    """Fill r, height and normal velocity of the eight corners; return the least height, m."""
    x, y, z, w = cube[QX], cube[QY], cube[QZ], cube[QW]
    # The columns of R times half a side.
    ax = half_side * (1.0 - 2.0 * (y * y + z * z))
    ay = half_side * (2.0 * (x * y + z * w))
    az = half_side * (2.0 * (x * z - y * w))
    bx = half_side * (2.0 * (x * y - z * w))
    by = half_side * (1.0 - 2.0 * (x * x + z * z))
    bz = half_side * (2.0 * (y * z + x * w))
    cx = half_side * (2.0 * (x * z + y * w))
    cy = half_side * (2.0 * (y * z - x * w))
    cz = half_side * (1.0 - 2.0 * (x * x + y * y))
    lowest = 1e300
    for k in range(8):
        i = 1.0 if k & 1 else -1.0
        j = 1.0 if k & 2 else -1.0
        m = 1.0 if k & 4 else -1.0
        rx = (i * ax + j * bx) + m * cx
        ry = (i * ay + j * by) + m * cy
        rz = (i * az + j * bz) + m * cz
        height = cube[Z] + rz
        corners[k, RX] = rx
        corners[k, RY] = ry
        corners[k, RZ] = rz
        corners[k, HEIGHT] = height
        corners[k, SPEED] = cube[VZ] + (cube[WX] * ry - cube[WY] * rx)
        lowest = min(lowest, height)
    return lowest


@compiled
def apply_impulse(
    cube: Floats, inverse_inertia: float, corner: Floats, jx: float, jy: float, jn: float
) -> None:
    """Change the velocities of a cube by an impulse at one of its corners."""
    cube[VX] += jx
    cube[VY] += jy
    cube[VZ] += jn
    cube[WX] += inverse_inertia * (corner[RY] * jn - corner[RZ] * jy)
    cube[WY] += inverse_inertia * (corner[RZ] * jx - corner[RX] * jn)
    cube[WZ] += inverse_inertia * (corner[RX] * jy - corner[RY] * jx)


@compiled
def solve_corners(
    cube: Floats, rules: Rules, friction: float, corners: Floats, tolerance: float, most: int
) -> int:
    """
    Change the velocities until every taking part corner obeys its law; return the sweeps it took.

    The law of a corner: its normal velocity is at least TARGET, its normal impulse not negative,
    one of the two at its bound; friction as in `cone_impulse`. Block Gauss-Seidel: corner after
    corner is solved exactly, until a sweep changes the velocities by less than `tolerance`, m/s
    (impulses that differ by what cancels out may go on changing). Impulses in the columns J are
    taken as applied already.
    """
    w = rules.inverse_inertia
    taking_part = 0
    for k in range(8):
        taking_part += corners[k, PART] > 0.0
    for sweep in range(most):
        vx, vy, vz = cube[VX], cube[VY], cube[VZ]
        wx, wy, wz = cube[WX], cube[WY], cube[WZ]
        for k in range(8):
            corner = corners[k]
            if corner[PART] > 0.0:
                rx, ry, rz = corner[RX], corner[RY], corner[RZ]
                jx, jy, jn = corner[JX], corner[JY], corner[JN]
                ux = cube[VX] + (cube[WY] * rz - cube[WZ] * ry)
                uy = cube[VY] + (cube[WZ] * rx - cube[WX] * rz)
                un = cube[VZ] + (cube[WX] * ry - cube[WY] * rx)
                # Without its own impulse, u - K j.
                along = w * ((rx * jx + ry * jy) + rz * jn)
                scale = 1.0 + w * ((rx * rx + ry * ry) + rz * rz)
                free_x = ux - (scale * jx - rx * along)
                free_y = uy - (scale * jy - ry * along)
                free_n = un - (scale * jn - rz * along)
                gain = corner[TARGET] - free_n
                if gain > 0.0:
                    nx, ny, nn = cone_impulse(rx, ry, rz, w, friction, free_x, free_y, gain)
                else:
                    nx, ny, nn = 0.0, 0.0, 0.0
                apply_impulse(cube, w, corner, nx - jx, ny - jy, nn - jn)
                corner[JX] = nx
                corner[JY] = ny
                corner[JN] = nn
        moved = (abs(cube[VX] - vx) + abs(cube[VY] - vy)) + abs(cube[VZ] - vz)
        turned = (abs(cube[WX] - wx) + abs(cube[WY] - wy)) + abs(cube[WZ] - wz)
        if taking_part == 1 or moved + rules.half_side * turned <= tolerance:
            return sweep + 1
    return most


@compiled
def energy(cube: Floats, inverse_inertia: float) -> float:
    """Return the kinetic energy of a cube, J."""
    v = (cube[VX] * cube[VX] + cube[VY] * cube[VY]) + cube[VZ] * cube[VZ]
    w = (cube[WX] * cube[WX] + cube[WY] * cube[WY]) + cube[WZ] * cube[WZ]
    joules: float = 0.5 * (v + w / inverse_inertia)
    return joules


@compiled
def bounce(cube: Floats, rules: Rules, corners: Floats, touch: float, spare: Floats) -> int:
    """
    Turn back the corners that hit the plane, all at once; return the sweeps it took.

    Newton's restitution with Coulomb's friction: a corner within `touch` of the plane that
    approaches at u_n leaves with at least -e u_n (or 0 below the threshold). With friction
    this law alone could create energy (Wang and Mason 1992). Where it would, the friction is
    scaled down just so far that the energy stays: the impulses go from the frictionless ones,
    which never create any, towards those of the cone, and on that line the energy is a
    parabola. Cones and restitution hold all along the line.
    """
    w = rules.inverse_inertia
    speed = 0.0
    for k in range(8):
        corner = corners[k]
        corner[PART] = 0.0
        corner[JX] = 0.0
        corner[JY] = 0.0
        corner[JN] = 0.0
        corner[TARGET] = 0.0
        # A corner that leaves already is not held: should the others throw it down, it hits next.
        if corner[HEIGHT] <= touch and corner[SPEED] <= rules.threshold:
            corner[PART] = 1.0
            if corner[SPEED] < -rules.threshold:
                corner[TARGET] = -(rules.restitution * corner[SPEED])
            speed = max(speed, -corner[SPEED])
    before = energy(cube, w)
    for n in range(13):
        spare[n] = cube[n]
    tolerance = 1e-14 * speed
    sweeps = solve_corners(cube, rules, rules.friction, corners, tolerance, 300)
    after = energy(cube, w)
    if rules.friction == 0.0 or after <= before:
        return sweeps

    for k in range(8):
        corner = corners[k]
        spare[16 + k] = corner[JN]
        corner[JN] = 0.0
    for n in range(VX, WZ + 1):
        swap = cube[n]
        cube[n] = spare[n]
        spare[n] = swap
    # `jx` and `jy` are zero in a frictionless solution; those of the cone stay for the blend.
    sweeps += solve_frictionless(cube, rules, corners, tolerance, 300)
    smooth = energy(cube, w)
    slope = 0.0
    square = 0.0
    for n in range(VX, WZ + 1):
        weight = 1.0 if n < WX else 1.0 / w
        difference = spare[n] - cube[n]
        slope += weight * cube[n] * difference
        square += weight * difference * difference
    room = max(before - smooth, 0.0)
    share = (math.sqrt(slope * slope + 2.0 * square * room) - slope) / square
    share = min(max(share, 0.0), 1.0)
    for n in range(VX, WZ + 1):
        cube[n] += share * (spare[n] - cube[n])
    for k in range(8):
        corner = corners[k]
        corner[JX] = share * corner[JX]
        corner[JY] = share * corner[JY]
        corner[JN] += share * (spare[16 + k] - corner[JN])
    return sweeps


@compiled
def solve_frictionless(
    cube: Floats, rules: Rules, corners: Floats, tolerance: float, most: int
) -> int:
    """Do as `solve_corners` without friction, and leave the columns JX and JY alone."""
    w = rules.inverse_inertia
    for sweep in range(most):
        change = 0.0
        for k in range(8):
            corner = corners[k]
            if corner[PART] > 0.0:
                rx, ry = corner[RX], corner[RY]
                un = cube[VZ] + (cube[WX] * ry - cube[WY] * rx)
                mass = 1.0 / (1.0 + w * (rx * rx + ry * ry))
                new = max(corner[JN] + mass * (corner[TARGET] - un), 0.0)
                gain = new - corner[JN]
                apply_impulse(cube, w, corner, 0.0, 0.0, gain)
                corner[JN] = new
                change = max(change, abs(gain))
        if change <= tolerance:
            return sweep + 1
    return most
