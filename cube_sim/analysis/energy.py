"""The mechanical energy of cubes of 1 kg, and what the integrator does to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics import Settings

Floats = NDArray[np.float64]

# The models whose flight is the report's semi-implicit Euler.
SEMI_IMPLICIT = ('simple', 'impulse')


def gravity_of(settings: Settings) -> Floats:
    """Return the acceleration of gravity (3,), m/s^2, world."""
    return settings.gravity * np.array(settings.gravity_direction)


def energies(poses: Floats, velocities: Floats, gravity: Floats, cube_size: float) -> Floats:
    """
    Return potential, translation and rotation energy (N, 3), J, of cubes of 1 kg.

    -m g.p from the origin, m v^2 / 2 and I w^2 / 2 with I = m c^2 / 6; `poses` (N, 7),
    `velocities` (N, 6), `gravity` (3,) m/s^2, `cube_size` c in m, all in world.
    """
    inertia = cube_size * cube_size / 6.0
    split = np.empty((len(poses), 3))
    split[:, 0] = -(poses[:, :3] @ gravity)
    split[:, 1] = 0.5 * np.sum(velocities[:, :3] ** 2, axis=1)
    split[:, 2] = 0.5 * inertia * np.sum(velocities[:, 3:] ** 2, axis=1)
    return split


def kinetic_energies(velocities: Floats, cube_size: float) -> Floats:
    """Return m v^2 / 2 + I w^2 / 2 (N,), J, of cubes of 1 kg with velocities (N, 6)."""
    inertia = cube_size * cube_size / 6.0
    doubled: Floats = (velocities * velocities) @ np.array([1, 1, 1, inertia, inertia, inertia])
    return 0.5 * doubled


def flight_gain(settings: Settings) -> float:
    """
    Return the energy that one step of free flight adds to a cube of 1 kg, J: never positive.

    Semi-implicit Euler, v' = v + g dt and p' = p + v' dt, changes m v^2 / 2 by
    m (g.v dt + g^2 dt^2 / 2) and -m g.p by -m (g.v dt + g^2 dt^2): together -m g^2 dt^2 / 2,
    whatever the velocity. The exact parabola of other models loses nothing.
    """
    if settings.model not in SEMI_IMPLICIT:
        return 0.0
    return -0.5 * (settings.gravity * settings.time_step) ** 2
