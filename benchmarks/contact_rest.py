"""
Whether what the model contact piles up stands, comes to rest and stays, beside its peers.

Run: python3 benchmarks/contact_rest.py. Cubes of 0.5 m, e = mu = 0.5, 240 steps a second unless
said otherwise. The peers' figures are from runs of the same scenes at mostly default settings.
"""

from __future__ import annotations

import math

import contact_speed as scenes
import numpy as np

from cube_sim.physics import World
from cube_sim.physics.penetration import cube_penetration, plane_penetration

FLAT = (0.0, 0.0, 0.0, 1.0)


def world(rate: int = scenes.RATE, **changes: object) -> World:
    """Return an empty world of the model contact."""
    return World(scenes.settings(True).changed(time_step_ns=round(1e9 / rate), **changes))


def deepest(cubes: World) -> float:
    """Return how deep any cube is in the plane or in another, m."""
    size = cubes.settings.cube_size
    depths, _ = cube_penetration(cubes.poses, size)
    return float(max(plane_penetration(cubes.poses, size).max(), depths.max(initial=0.0)))


def stack(rate: int) -> str:
    """Return how far the cubes of a stack of ten drift in a minute, without sleep."""
    tower = world(rate, sleep=False)
    tower.throw([(0.0, 0.0, 0.25 + 0.5 * level) for level in range(10)], FLAT)
    start = tower.poses[:, :3].copy()
    tower.step(60 * rate)
    return f'{1e3 * np.abs(tower.poses[:, :3] - start).max():.4f} mm'


def crooked_stacks() -> str:
    """Return how fast a hundred stacks of ten, each cube 3 cm and 0.3 rad off, sway after 6 s."""
    rng = np.random.default_rng(1)
    stacks = world(sleep=False)
    n = np.arange(1000)
    places = np.stack([3.0 * (n // 10), np.zeros(1000), 0.25 + 0.5 * (n % 10)], 1)
    places[:, :2] += rng.uniform(-0.03, 0.03, (1000, 2))
    turns = 0.5 * rng.uniform(-0.3, 0.3, 1000)
    stacks.throw(places, np.stack([0.0 * n, 0.0 * n, np.sin(turns), np.cos(turns)], 1))
    stacks.step(6 * scenes.RATE)
    return f'{np.abs(stacks.velocities[:, :3]).max():.1e} m/s'


def thrown_apart(sleep: bool) -> World:
    """Return a thousand cubes thrown at 8 m/s from places 0.9 m apart, ten seconds later."""
    _, turns, velocities, spins = scenes.thrown()
    n = np.arange(scenes.COUNT)
    places = np.stack([0.9 * (n % 32), 0.9 * (n // 32), np.full(scenes.COUNT, 1.5)], 1)
    cubes = world(sleep=sleep)
    cubes.throw(places, turns, velocities, spins)
    cubes.step(10 * scenes.RATE)
    return cubes


def thrown() -> tuple[str, str, str]:
    """Return speed and spin, penetration, and how many sleepers lost a bit in another second."""
    cubes = thrown_apart(sleep=False)
    v, w = np.abs(cubes.velocities[:, :3]).max(), np.abs(cubes.velocities[:, 3:]).max()
    sleepers = thrown_apart(sleep=True)
    before = sleepers.poses.copy()
    sleepers.step(scenes.RATE)
    changed = int((sleepers.poses != before).any(axis=1).sum())
    return f'{v:.1e} m/s, {w:.1e} rad/s', f'{1e3 * deepest(cubes):.3f} mm', f'{changed}'


def pile() -> tuple[str, str]:
    """Return when a pile of a thousand is asleep, and how deep any cube of it is in another."""
    cubes = world()
    cubes.throw(*scenes.pile())
    for second in range(1, 61):
        cubes.step(scenes.RATE)
        if cubes.awake == 0:
            return f'{second} s', f'{1e3 * deepest(cubes):.3f} mm'
    return f'{cubes.awake} awake after 60 s', f'{1e3 * deepest(cubes):.3f} mm'


def volley() -> str:
    """Return how deep cubes at 100 m/s get in the plane or a block of cubes at any step."""
    rng = np.random.default_rng(1)
    cubes = world()
    n = np.arange(64)
    cubes.throw(np.stack([0.55 * (n // 16), 0.55 * (n // 4 % 4), 0.25 + 0.5 * (n % 4)], 1), FLAT)
    worst = -math.inf
    for shot in range(40):
        if shot % 2:
            place, velocity = (-6.0, rng.uniform(0.0, 1.6), 0.9), (100.0, 0.0, 0.0)
        else:
            place, velocity = (*rng.uniform(0.0, 1.6, 2), 9.0), (0.0, 0.0, -100.0)
        cubes.throw(place, rng.normal(size=4), velocity)
        for _ in range(scenes.RATE // 4):
            cubes.step()
            worst = max(worst, deepest(cubes))
    return f'{1e3 * worst:.1f} mm'


def main() -> None:
    """Measure and print the table."""
    print('| quantity | cube_sim | to reach | peers |\n|---|---|---|---|')
    speed, depth, changed = thrown()
    when, pile_depth = pile()
    drift = 'MuJoCo ~0, Box3D 0.5 mm, Jolt 1.4 mm, Rapier 2.0, Bullet 4.5'
    for name, measured, aim, peers in (
        ('stack of ten, 60 s, 240 Hz: drift', stack(240), '0.5 mm', drift),
        ('stack of ten, 60 s, 60 Hz: drift', stack(60), '0.5 mm', 'Jolt 101 mm'),
        ('100 crooked stacks of ten after 6 s', crooked_stacks(), '', ''),
        ('1000 thrown, 10 s, no sleep', speed, '1e-5 m/s, 1e-4 rad/s', ''),
        ('the same: penetration', depth, '0.1 mm', 'slop: Box3D 5 mm, Jolt 20 mm'),
        ('the same asleep: poses changed in 1 s', changed, '0', ''),
        ('pile of 1000: all asleep after', when, 'at all', ''),
        ('the same: penetration', pile_depth, '', ''),
        ('at 100 m/s into plane and cubes', volley(), 'no tunnelling', ''),
    ):
        print(f'| {name} | {measured} | {aim} | {peers} |', flush=True)


if __name__ == '__main__':
    main()
