"""A scripted run for each model, and the bits in which it ends."""

from __future__ import annotations

import numpy as np
from support.physics_states import crowd

# World.digest() after `run_script`. These may change only where the laws do.
GOLDEN = {
    'simple': '240d7c43b304fc3aaca59f49527de6c921a84be44c952ca33a5850f72f9d8521',
    # Of the runs in test_contact_cubes.
    'pile': '0631fb28c7baae30c0f30704780107cbfac8ed28a263927fca24b3550f381c9b',
    'contact': 'f36b7a4073e8f98e6de8e7837a009f24b3408dd1f9c6c9f716fe37d81a5bc6db',
    'impulse': '4ce3b631de96d474b9cadd9bb20b1f164d3a20dfdca116a8c9ff378850bdf903',
}

STEPS, CUBES_LEFT = 600, 899


def run_script(world, advance, seed: int = 2) -> None:
    """
    A run of 600 steps with all that can happen between steps; `advance(n)` takes n of them.

    Cubes come in waves, the settings change in flight, gravity tilts, a reset empties the world.
    """
    waves = crowd(1200, seed)

    def wave(first: int, last: int) -> None:
        world.throw(*(np.array(column) for column in zip(*waves[first:last], strict=True)))

    wave(0, 300)
    advance(210)
    wave(300, 301)
    world.configure(restitution=0.75, friction=0.25, tangential_factor=0.5)
    advance(130)
    world.reset()
    wave(301, 1100)
    world.configure(gravity_direction=(0.28, 0.0, -0.96), gravity=3.7)
    advance(160)
    wave(1100, 1200)
    world.configure(cube_size=0.375)
    advance(100)
