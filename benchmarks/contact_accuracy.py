"""
How near the model contact comes to closed forms, beside what peers were measured to reach.

Run: python3 benchmarks/contact_accuracy.py. Cubes of 0.5 m, 240 steps a second unless said
otherwise. The peers' figures are from runs of the same scenes at mostly default settings.
"""

from __future__ import annotations

import math

import numpy as np

from cube_sim.physics import Settings, World

RATE = 240
FLAT = (0.0, 0.0, 0.0, 1.0)


def world(rate: int = RATE, **changes: object) -> World:
    """Return an empty world of the model contact."""
    return World(Settings(model='contact', time_step_ns=round(1e9 / rate)).changed(**changes))


def rebound() -> str:
    """Return the error of the rebound height after a flat drop from 1 m at e = 0.5."""
    drop = world()
    drop.throw((0.0, 0.0, 1.25), FLAT)
    drop.step(130)
    speed = drop.velocities[0, 2]
    apex = drop.poses[0, 2] - 0.25 + speed * speed / (2.0 * 9.81)
    return f'{100.0 * (apex / 0.25 - 1.0):+.1e} %'


def sliding() -> str:
    """Return the error of the distance after which a cube at 3 m/s stops, mu = 0.5."""
    slide = world()
    slide.throw((0.0, 0.0, 0.25), FLAT, (3.0, 0.0, 0.0))
    slide.step(2 * RATE)
    return f'{100.0 * (slide.poses[0, 0] / (9.0 / 9.81) - 1.0):+.1e} %'


def slope(share: float) -> str:
    """Return how far a cube goes in a minute where tan(angle) is `share` times the friction."""
    angle = math.atan(0.5 * share)
    tilted = world(gravity_direction=(math.sin(angle), 0.0, -math.cos(angle)))
    tilted.throw((0.0, 0.0, 0.25), FLAT)
    tilted.step(60 * RATE)
    return f'{math.hypot(*tilted.poses[0, :2]):.2e} m'


def elastic() -> str:
    """Return the relative RMS error of the energy of 49 elastic cubes after 20 s at 1 ms."""
    rng = np.random.default_rng(1)
    turns = rng.normal(size=(49, 4))
    bouncing = world(1000, restitution=1.0, friction=0.0, collide_cubes=False)
    bouncing.throw((0.0, 0.0, 3.0), turns)
    bouncing.step(20_000)
    v, w = bouncing.velocities[:, :3], bouncing.velocities[:, 3:]
    now = 0.5 * (v * v).sum(1) + 0.25 / 12.0 * (w * w).sum(1) + 9.81 * bouncing.poses[:, 2]
    return f'{math.sqrt(np.mean((now / (9.81 * 3.0) - 1.0) ** 2)):.1e}'


def stack(rate: int) -> str:
    """Return how far the cubes of a stack of ten drift in a minute, without sleep."""
    tower = world(rate, sleep=False)
    tower.throw([(0.0, 0.0, 0.25 + 0.5 * level) for level in range(10)], FLAT)
    start = tower.poses[:, :3].copy()
    tower.step(60 * rate)
    return f'{1e3 * np.abs(tower.poses[:, :3] - start).max():.4f} mm'


def main() -> None:
    """Measure and print the table."""
    print('| quantity | cube_sim | peers |\n|---|---|---|')
    for name, measured, peers in (
        ('rebound of a 1 m drop', rebound(), 'MuJoCo -1.1 %, DART +2.1 %, Rapier -2.9 %'),
        ('sliding stop from 3 m/s', sliding(), 'Box3D -0.13 %, Bullet -3.0 %'),
        ('slope, 0.99 mu, 60 s', slope(0.99), ''),
        ('slope, 1.01 mu, 60 s', slope(1.01), 'closed form 78.81 m'),
        ('energy, 49 elastic, 20 s', elastic(), 'RaiSim 5.7e-6, ODE 5.7e-4 (balls)'),
        ('stack of ten, 60 s, 240 Hz', stack(240), 'MuJoCo ~0, Box3D 0.5 mm, Jolt 1.4 mm'),
        ('stack of ten, 60 s, 60 Hz', stack(60), 'Jolt 101 mm'),
    ):
        print(f'| {name} | {measured} | {peers} |', flush=True)


if __name__ == '__main__':
    main()
