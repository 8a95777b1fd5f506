"""Compile the models ahead of time: `python -m cube_sim.physics.warm_up`."""

from __future__ import annotations

from cube_sim.physics.models import MODELS
from cube_sim.physics.settings import Settings
from cube_sim.physics.world import World


def warm_up() -> None:
    """Run a step of each model, so that its machine code is there."""
    for model in MODELS:
        world = World(Settings(model=model))
        world.throw((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (1.0, 2.0, 3.0))
        world.step()


if __name__ == '__main__':
    warm_up()
