"""Compile the step ahead of time: `python -m cube_sim.physics.warm_up`."""

from __future__ import annotations

from cube_sim.physics.world import World


def warm_up() -> None:
    """Run a step, so that its machine code is there."""
    world = World()
    world.throw((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    world.step()


if __name__ == '__main__':
    warm_up()
