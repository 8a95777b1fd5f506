"""The model `contact`, cubes that meet: stacks, piles, momentum, sleep, and the same bits."""

from __future__ import annotations

import numpy as np
import pytest
from support.physics_states import Draw, crowd, thrown

from cube_sim.physics import Settings, World

FLAT = (0.0, 0.0, 0.0, 1.0)
INERTIA = 0.25 / 6.0


def settings(rate: int = 240, **changes) -> Settings:
    values = {'model': 'contact', 'cube_size': 0.5, 'time_step_ns': round(1e9 / rate), **changes}
    return Settings(**values)


@pytest.mark.parametrize('rate', [60, 240])
@pytest.mark.parametrize('sleep', [False, True])
def test_a_stack_of_ten_stands_for_a_minute(rate, sleep):
    world = World(settings(rate, sleep=sleep))
    for level in range(10):
        world.throw((0.0, 0.0, 0.25 + 0.5 * level), FLAT)
    start = world.poses[:, :3].copy()
    world.step(60 * rate)
    assert np.abs(world.poses[:, :3] - start).max() < 5e-4
    assert world.awake == (0 if sleep else 10)


def momentum(world: World) -> tuple[np.ndarray, np.ndarray, float]:
    p, v, w = world.poses[:, :3], world.velocities[:, :3], world.velocities[:, 3:]
    angular = (np.cross(p, v) + INERTIA * w).sum(axis=0)
    return v.sum(axis=0), angular, float(0.5 * (v * v).sum() + 0.5 * INERTIA * (w * w).sum())


def test_cubes_that_collide_keep_their_momentum_and_gain_no_energy():
    hits = 0
    for seed in range(100):
        draw = Draw(seed)
        world = World(
            settings(
                gravity=0.0,
                restitution=(0.0, 0.5, 1.0)[seed % 3],
                friction=(0.0, 0.3, 1.0, 3.0)[seed % 4],
            )
        )
        world.throw((0.0, 0.0, 50.0), draw.orientation(), (0.0, 0.0, 0.0), draw.vector(-1.0, 1.0))
        way = np.array(draw.orientation()[:3])
        way /= np.linalg.norm(way)
        aim = 2.0 * way + draw.vector(-0.2, 0.2) + (0.0, 0.0, 50.0)
        world.throw(aim, draw.orientation(), -10.0 * way, draw.vector(-3.0, 3.0))
        linear, angular, energy = momentum(world)
        for _ in range(100):
            world.step()
        after = momentum(world)
        np.testing.assert_allclose(after[0], linear, rtol=0, atol=1e-12)
        np.testing.assert_allclose(after[1], angular, rtol=0, atol=5e-10)
        assert after[2] <= energy * (1.0 + 1e-9)
        hits += abs(world.velocities[0, :3]).max() > 0.01
    assert hits > 90


@pytest.mark.parametrize('rate', [60, 240])
@pytest.mark.parametrize('speed', [10.0, 30.0, 100.0])
def test_no_cube_passes_through_another(rate, speed):
    # Head on, without gravity: the one that is hit must go before the other.
    for offset in (0.0, 0.05, 0.2):
        draw = Draw(round(speed + 100 * offset))
        world = World(settings(rate, gravity=0.0, friction=0.0))
        world.throw((0.0, 0.0, 50.0), draw.orientation())
        world.throw((-3.0, offset, 50.0), draw.orientation(), (speed, 0.0, 0.0))
        for _ in range(round(6.0 / speed * rate) + 2):
            world.step()
            assert world.poses[1, 0] < world.poses[0, 0]
        assert world.velocities[0, 0] > 0.2 * speed


def run(world: World, batch: int) -> str:
    """A scripted run in batches of steps; its digest."""
    for first, last in ((0, 40), (40, 120)):
        for throw in crowd(120, seed=8)[first:last]:
            world.throw(*throw)
        for _ in range(240 // batch):
            world.step(batch)
        world.configure(friction=0.3 if first == 0 else 0.7)
    for _ in range(240 // batch):
        world.step(batch)
    return world.digest()


def test_the_bits_do_not_depend_on_the_batching_or_on_threads():
    (digest,) = {
        run(World(settings(), threads=threads), batch)
        for threads, batch in ((1, 1), (1, 240), (3, 30))
    }
    assert len(digest) == 64


def test_sleepers_keep_their_bits_until_something_meets_them():
    world = World(settings())
    for level in range(3):
        world.throw((0.0, 0.0, 0.25 + 0.5 * level), FLAT)
    world.throw((0.0, 50.0, 0.25), FLAT)
    world.step(480)
    assert world.awake == 0
    poses = world.poses.copy()
    world.throw((-3.0, 0.0, 0.8), FLAT, (15.0, 0.0, 0.0))
    world.step(12)
    assert world.poses[:4].tobytes() == poses.tobytes()
    world.step(228)
    assert np.abs(world.poses[:3] - poses[:3]).max() > 0.1
    assert world.poses[3].tobytes() == poses[3].tobytes()


def test_a_change_of_gravity_wakes_everyone():
    world = World(settings())
    world.throw((0.0, 0.0, 0.25), FLAT)
    world.step(480)
    assert world.awake == 0
    world.configure(gravity_direction=(0.6, 0.0, -0.8))
    assert world.awake == 1
    world.step(240)
    assert world.poses[0, 0] > 0.5


def test_a_reset_forgets_contacts_and_sleep():
    fresh, used = World(settings()), World(settings())
    for throw in crowd(60, seed=9):
        used.throw(*throw)
    fresh.step(480)
    used.step(480)
    used.reset()
    for world in (fresh, used):
        for throw in crowd(40, seed=10):
            world.throw(*throw)
        world.step(240)
    assert used.digest() == fresh.digest()


def test_a_switch_of_the_model_starts_afresh():
    worlds = []
    for stay in (0, 240):
        world = thrown(settings(), crowd(30, seed=11))
        world.step(stay)
        world.configure(model='impulse')
        world.reset()
        world.step(240 - stay)
        world.configure(model='contact')
        for throw in crowd(30, seed=12):
            world.throw(*throw)
        world.step(240)
        worlds.append(world.digest())
    assert worlds[0] == worlds[1]


def test_the_contact_points_carry_the_weight():
    world = World(settings(sleep=False))
    for level in range(3):
        world.throw((0.0, 0.0, 0.25 + 0.5 * level), FLAT)
    world.step(480)
    points = world.contact_points
    assert set(map(tuple, points.cubes)) == {(0, -1), (0, 1), (1, 2)}
    weight = 9.81 / 240
    for pair, load in (((0, -1), 3.0), ((0, 1), -2.0), ((1, 2), -1.0)):
        chosen = (points.cubes == pair).all(axis=1)
        total = points.impulses[chosen].sum(axis=0)
        assert total[2] == pytest.approx(load * weight, rel=1e-3)
    np.testing.assert_allclose(np.abs(points.normals[:, 2]), 1.0, atol=1e-6)
    assert world.counters['touching_pairs'] >= 3
