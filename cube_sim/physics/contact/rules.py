"""What a step of the model computes with."""

from __future__ import annotations

from typing import NamedTuple

from cube_sim.physics.settings import Settings


class Rules(NamedTuple):
    """
    The numbers of one step, SI units.

    `gx/gy/gz` is the acceleration of gravity; `inverse_inertia` that of a cube of 1 kg;
    `threshold` the approach speed below which an impact is inelastic; `collide` and `sleep` are
    1 or 0.
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
    )
