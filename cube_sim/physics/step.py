"""
One step of every cube: motion, detection, response.

The state is an array (13, capacity) of float64 with a row for each component, so that the motion
of many cubes is one stream of vector instructions; the columns are the cubes. Blocks of cubes
that fit the cache take all their steps before the next block does: cubes of these models do not
touch each other, so neither the batching nor the order of the blocks can change a bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.constants import Constants, Velocities
from cube_sim.physics.detection import contact_point, lowest_corner
from cube_sim.physics.models import impulse, simple
from cube_sim.physics.rotation import composed, fill_rotors, rotor

Floats = NDArray[np.float64]

# Rows of the state: position m, orientation, linear velocity m/s, angular velocity rad/s; world.
PX, PY, PZ, QX, QY, QZ, QW, VX, VY, VZ, WX, WY, WZ = range(13)
ROWS = 13

# Cubes of a block: their state and scratch, 17 numbers each, stay in a first-level cache of 48 KiB.
BLOCK = 256
SCRATCH_ROWS = 5


@compiled
def advance(
    state: Floats,
    first: int,
    last: int,
    steps: int,
    model: int,
    numbers: Floats,
    scratch: Floats,
) -> int:
    """
    Advance the cubes first to last - 1 by `steps` steps; return how many contacts they had.

    `numbers` (9,) are the Constants; `scratch` (SCRATCH_ROWS, BLOCK) is memory to work in.
    """
    constants = Constants(
        numbers[0],
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4],
        numbers[5],
        numbers[6],
        numbers[7],
        numbers[8],
    )
    contacts = 0
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        px, py, pz = state[PX, start:end], state[PY, start:end], state[PZ, start:end]
        qx, qy, qz, qw = (
            state[QX, start:end],
            state[QY, start:end],
            state[QZ, start:end],
            state[QW, start:end],
        )
        vx, vy, vz = state[VX, start:end], state[VY, start:end], state[VZ, start:end]
        wx, wy, wz = state[WX, start:end], state[WY, start:end], state[WZ, start:end]
        lowest = scratch[4, : end - start]
        # A spin is constant until a contact changes it, and so is the rotation of one step.
        turn_x = scratch[0, : end - start]
        turn_y = scratch[1, : end - start]
        turn_z = scratch[2, : end - start]
        turn_w = scratch[3, : end - start]
        fill_rotors(wx, wy, wz, constants.time_step, turn_x, turn_y, turn_z, turn_w)

        for _ in range(steps):
            # Motion: semi-implicit Euler for the centre, the exact exponential for the turn.
            for i in range(end - start):
                vx[i] += constants.gain_x
                vy[i] += constants.gain_y
                vz[i] += constants.gain_z
                px[i] += vx[i] * constants.time_step
                py[i] += vy[i] * constants.time_step
                pz[i] += vz[i] * constants.time_step
                x, y, z, w = composed(
                    turn_x[i], turn_y[i], turn_z[i], turn_w[i], qx[i], qy[i], qz[i], qw[i]
                )
                scale = 1.0 / math.sqrt((x * x + y * y) + (z * z + w * w))
                qx[i] = x * scale
                qy[i] = y * scale
                qz[i] = z * scale
                qw[i] = w * scale
                # Detection: no corner is below the lowest one.
                lowest[i] = lowest_corner(pz[i], qx[i], qy[i], qz[i], qw[i], constants.half_side)

            # Response, of those that penetrate only: out of the plane, then new velocities.
            for i in range(end - start):
                if lowest[i] < 0.0:
                    contacts += 1
                    rx, ry, rz = contact_point(
                        pz[i], qx[i], qy[i], qz[i], qw[i], constants.half_side
                    )
                    pz[i] -= lowest[i]
                    vx[i], vy[i], vz[i], wx[i], wy[i], wz[i] = respond(
                        model, constants, rx, ry, rz, vx[i], vy[i], vz[i], wx[i], wy[i], wz[i]
                    )
                    turn_x[i], turn_y[i], turn_z[i], turn_w[i] = rotor(
                        wx[i], wy[i], wz[i], constants.time_step
                    )
    return contacts


@compiled
def respond(
    model: int,
    constants: Constants,
    rx: float,
    ry: float,
    rz: float,
    vx: float,
    vy: float,
    vz: float,
    wx: float,
    wy: float,
    wz: float,
) -> Velocities:
    """Return the velocities after a contact, by the model of that code."""
    if model == simple.CODE:
        return simple.respond(constants, rx, ry, rz, vx, vy, vz, wx, wy, wz)
    return impulse.respond(constants, rx, ry, rz, vx, vy, vz, wx, wy, wz)


def entry(types: Any, carray: Any) -> tuple[Any, Any]:
    """Return the signature and the function by which machine code is called (machine_code.STEP)."""
    floats, integer = types.CPointer(types.float64), types.int64
    scratch_shape = (SCRATCH_ROWS, BLOCK)
    rows, numbers_count = ROWS, len(Constants._fields)

    def call(  # type: ignore[no-untyped-def]
        state, numbers, scratch, capacity, first, last, steps, model
    ):
        return advance(
            carray(state, (rows, capacity)),
            first,
            last,
            steps,
            model,
            carray(numbers, numbers_count),
            carray(scratch, scratch_shape),
        )

    return integer(floats, floats, floats, integer, integer, integer, integer, integer), call
