"""What a step computes with, and the types that it hands on."""

from __future__ import annotations

from typing import NamedTuple

# vx vy vz m/s, wx wy wz rad/s, frame world.
Velocities = tuple[float, float, float, float, float, float]


class Constants(NamedTuple):
    """
    The numbers of one step.

    `gain_x/y/z` is the velocity that gravity adds in one step, m/s, frame world;
    `inverse_inertia` is 1/I of a cube of 1 kg, I = side^2/6, 1/(kg m^2).
    """

    time_step: float
    gain_x: float
    gain_y: float
    gain_z: float
    half_side: float
    inverse_inertia: float
    restitution: float
    friction: float
    tangential_factor: float
