"""What a step of the model computes with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.settings import Settings

# The least sweeps over what touches in a sub-step. With two, stacks of ten never come to rest.
SWEEPS = 4


class Rules(NamedTuple):
    """
    The numbers of one step, SI units.

    `gx/gy/gz` is the acceleration of gravity; `inverse_inertia` that of a cube of 1 kg;
    `threshold` the approach speed below which an impact is inelastic; `collide` and `sleep` are
    1 or 0; `substep` the longest part in which touching cubes are solved, `sweeps` the least
    number of sweeps in one.
    """

    time_step: float
    gx: float
    gy: float
    gz: float
    gravity: float
    half_side: float
    inverse_inertia: float
    restitution: float
    friction: float
    threshold: float
    collide: float
    sleep: float
    sleep_speed: float
    sleep_delay: float
    substep: float
    sweeps: float


def rules_of(settings: Settings) -> Rules:
    """Return the numbers of a step by these settings."""
    x, y, z = settings.gravity_direction
    side, lost = settings.cube_size, 1.0 - settings.restitution * settings.restitution
    return Rules(
        time_step=settings.time_step,
        gx=settings.gravity * x,
        gy=settings.gravity * y,
        gz=settings.gravity * z,
        gravity=settings.gravity,
        half_side=0.5 * side,
        inverse_inertia=6.0 / (side * side),
        restitution=settings.restitution,
        friction=settings.friction,
        # What an inelastic small impact loses beyond the law must vanish as e goes to 1, where
        # energy is to stay: the threshold is scaled by the share that an impact loses anyway.
        threshold=settings.restitution_threshold * lost
        + 1e-6 * settings.gravity * settings.time_step,
        collide=1.0 if settings.collide_cubes else 0.0,
        sleep=1.0 if settings.sleep else 0.0,
        sleep_speed=settings.sleep_speed,
        sleep_delay=settings.sleep_delay,
        substep=settings.solver_substep,
        sweeps=max(1.0, float(round(SWEEPS * settings.solver_effort))),
    )


@compiled
def rules_of_part(numbers: NDArray[np.float64], parts: int) -> Rules:
    """Return the rules `numbers` as they hold for one of so many parts of a step."""
    return Rules(
        numbers[0] / parts,
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4],
        numbers[5],
        numbers[6],
        numbers[7],
        numbers[8],
        numbers[9],
        numbers[10],
        numbers[11],
        numbers[12],
        numbers[13],
        numbers[14],
        numbers[15],
    )
