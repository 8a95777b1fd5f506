"""
One point of one pair of a block: how its two bodies move against each other, and are pushed.

Each function works on lane i of a block, and on the velocities (or displacements) of both bodies
in `work`. All are small: they become part of the loops over lanes that call them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled_inside
from cube_sim.physics.contact.layout import (
    ARM,
    HALF,
    INERTIA_A,
    INERTIA_B,
    LANES,
    MASS_A,
    MASS_B,
    WAY,
    WORK_A,
    WORK_B,
    X,
    Y,
    Z,
)

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]
Arms = tuple[float, float, float, float, float, float]

# Columns of the work: linear and angular part of either body.
AV, AW = WORK_A, WORK_A + 3 * LANES
BV, BW = WORK_B, WORK_B + 3 * LANES


@compiled_inside
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Vector:
    """Return the vector product a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@compiled_inside
def arms_now(block: Floats, point: Floats, i: int) -> Arms:
    """Return where the point lies now from the centre of either body, m, world."""
    ax = point[ARM + X + i] + block[HALF + X + i]
    ay = point[ARM + Y + i] + block[HALF + Y + i]
    az = point[ARM + Z + i] + block[HALF + Z + i]
    bx = ax - block[WAY + X + i]
    by = ay - block[WAY + Y + i]
    bz = az - block[WAY + Z + i]
    return ax, ay, az, bx, by, bz


@compiled_inside
def parting(work: Floats, i: int, arms: Arms) -> Vector:
    """Return the velocity of the second body against the first in a point, m/s, world."""
    ax, ay, az, bx, by, bz = arms
    px, py, pz = cross(work[AW + X + i], work[AW + Y + i], work[AW + Z + i], ax, ay, az)
    qx, qy, qz = cross(work[BW + X + i], work[BW + Y + i], work[BW + Z + i], bx, by, bz)
    ux = (work[BV + X + i] - work[AV + X + i]) + (qx - px)
    uy = (work[BV + Y + i] - work[AV + Y + i]) + (qy - py)
    uz = (work[BV + Z + i] - work[AV + Z + i]) + (qz - pz)
    return ux, uy, uz


@compiled_inside
def apply_to_both(
    block: Floats, work: Floats, i: int, arms: Arms, jx: float, jy: float, jz: float
) -> None:
    """Change the velocities by the impulse (jx, jy, jz) on the second body and its opposite."""
    ax, ay, az, bx, by, bz = arms
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
