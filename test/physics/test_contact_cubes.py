"""The model `contact`, cubes that meet: stacks, piles, momentum, sleep, and the same bits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.physics_golden import GOLDEN
from support.physics_states import Draw, crowd, thrown

from cube_sim.physics import Settings, World
from cube_sim.physics.penetration import cube_penetration, plane_penetration

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


def crooked_towers(count: int) -> World:
    """Towers of ten whose cubes are up to 3 cm and 0.3 rad off, without sleep."""
    draw, world = Draw(21), World(settings(sleep=False))
    for tower in range(count):
        for level in range(10):
            x, y = draw.vector(-0.03, 0.03, 2)
            angle = 0.5 * draw.number(-0.3, 0.3)
            turn = (0.0, 0.0, math.sin(angle), math.cos(angle))
            world.throw((x + 3.0 * tower, y, 0.25 + 0.5 * level), turn)
    return world


@pytest.mark.parametrize('count', [1, 100])
def test_crooked_towers_come_to_rest_and_stay(count):
    world = crooked_towers(count)
    start = world.poses[:, :3].copy()
    world.step(6 * 240)
    assert np.abs(world.velocities[:, :3]).max() < 1e-5
    assert np.abs(world.velocities[:, 3:]).max() < 1e-4
    # A hundred at once begin without a finished solution: they sag by what it takes to find it.
    assert np.abs(world.poses[:, :3] - start).max() < (2e-4 if count == 1 else 3e-3)
    settled = world.poses[:, :3].copy()
    world.step(10 * 240)
    assert np.abs(world.poses[:, :3] - settled).max() < 5e-5


def deepest(world: World) -> tuple[float, float]:
    """How deep cubes are in the plane, and in each other, at most, m."""
    depths, _ = cube_penetration(world.poses, world.settings.cube_size)
    in_plane = plane_penetration(world.poses, world.settings.cube_size).max()
    return in_plane, depths.max(initial=0.0)


@pytest.mark.parametrize('rate', [60, 240])
def test_a_thousand_cubes_thrown_at_each_other_come_to_rest_without_sleep(rate):
    draw, world = Draw(22), World(settings(rate, sleep=False))
    for index in range(1000):
        place = (0.9 * (index % 32), 0.9 * (index // 32), 1.5)
        way = np.array(draw.orientation()[:3])
        way *= 8.0 / np.linalg.norm(way)
        world.throw(place, draw.orientation(), way, (1.0, 2.0, 3.0))
    world.step(10 * rate)
    assert np.abs(world.velocities[:, :3]).max() < 1e-5
    assert np.abs(world.velocities[:, 3:]).max() < 1e-4
    assert world.counters['touching_pairs'] > 300
    assert max(deepest(world)) < 1e-4


def dropped_pile(seed: int, **changes) -> World:
    """A thousand cubes in ten layers, each turned at random, 0.8 m apart, to be dropped."""
    draw, world = Draw(seed), World(settings(**changes))
    for index in range(1000):
        x, y, z = index // 100, index // 10 % 10, index % 10
        world.throw((0.8 * x, 0.8 * y, 1.0 + 0.8 * z), draw.orientation())
    return world


@pytest.mark.parametrize('seed', [23, 24])
def test_a_pile_of_a_thousand_falls_asleep_and_keeps_its_bits(seed):
    world = dropped_pile(seed)
    energy = math.inf
    for _ in range(60):
        world.step(120)
        v, w, z = world.velocities[:, :3], world.velocities[:, 3:], world.poses[:, 2]
        now = 0.5 * (v * v).sum() + 0.5 * INERTIA * (w * w).sum() + 9.81 * z.sum()
        assert now <= energy + 0.1
        energy = now
        if world.awake == 0:
            break
    assert world.awake == 0
    in_plane, in_cubes = deepest(world)
    assert in_plane < 1e-4
    assert in_cubes < 5e-4
    assert world.poses[:, 2].max() < 9.0
    poses = world.poses.tobytes()
    world.step(240)
    assert world.poses.tobytes() == poses


@pytest.mark.parametrize('batch', [7, 420])
def test_a_falling_pile_passes_the_golden_state(batch):
    world = dropped_pile(23)
    for _ in range(420 // batch):
        world.step(batch)
    assert world.counters['touching_pairs'] > 1000
    assert world.digest() == GOLDEN['pile']


@pytest.mark.parametrize('rate', [60, 240])
def test_nothing_goes_through_the_plane_or_a_pile_at_100_metres_a_second(rate):
    draw, world = Draw(25), World(settings(rate))
    for index in range(64):
        x, y, z = index // 16, index // 4 % 4, index % 4
        world.throw((0.55 * x, 0.55 * y, 0.25 + 0.5 * z), FLAT)
    worst = np.zeros(2)
    for _ in range(3):
        for n in range(4):
            x, y = 1.1 * (n % 2) + 0.2, 1.1 * (n // 2) + 0.2
            world.throw((x, y, 12.0), draw.orientation(), (0.0, 0.0, -100.0))
            world.throw((-8.0, n, 0.9), draw.orientation(), (100.0, 0.0, 0.0))
            world.throw((99.0, 9.0 * len(world), 2.0), draw.orientation(), (0.0, 0.0, -100.0))
        for _ in range(rate // 2):
            world.step()
            worst = np.maximum(worst, deepest(world))
    assert worst[0] < 0.01
    assert worst[1] < 0.05
    world.step(3 * rate)
    assert max(deepest(world)) < 1e-3


@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_cubes_thrown_from_one_place_part_without_gaining_energy(friction):
    world = World(settings(friction=friction))
    world.throw(np.tile([0.0, 0.0, 40.0], (10, 1)), FLAT, (8.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    energy = 10 * 0.5 * INERTIA * 14.0
    for _ in range(40):
        world.step(5)
        # Seen from a frame that was thrown along with them.
        v = world.velocities[:, :3] - (8.0, 0.0, -9.81 * world.time_ns / 1e9)
        now = 0.5 * (v * v).sum() + 0.5 * INERTIA * (world.velocities[:, 3:] ** 2).sum()
        assert now <= energy * (1.0 + 1e-9)
    assert deepest(world)[1] < 0.05


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
            assert after[2] <= energy * (1.0 + 1e-14)
            energy = after[2]
        np.testing.assert_allclose(after[0], linear, rtol=0, atol=1e-12)
        np.testing.assert_allclose(after[1], angular, rtol=0, atol=5e-10)
        hits += abs(world.velocities[0, :3]).max() > 0.01
    assert hits > 90


@pytest.mark.parametrize('rate', [60, 240, 500, 1000])
@pytest.mark.parametrize('turned', [False, True])
def test_elastic_cubes_that_meet_keep_their_energy(rate, turned):
    # Also with round speeds and gaps, with which the gap closes right at the end of a sub-step.
    draw, count = Draw(26), 200
    world = World(settings(rate, gravity=0.0, restitution=1.0, friction=0.0))
    for index in range(count):
        speed, gap = 1 + index % 10, 0.5 + 0.1 * (index // 10)
        middle = np.array([100.0 * (index % 14 - 7), 9.0 * (index // 14 - 7), 50.0])
        for side in (-1.0, 1.0):
            turn, spin = FLAT, (0.0, 0.0, 0.0)
            if turned:
                turn, spin = draw.orientation(), draw.vector(-3.0, 3.0)
            place = np.add(middle, (0.5 * side * (gap + 0.5), 0.0, 0.0))
            world.throw(place, turn, (-0.5 * side * speed, 0.0, 0.0), spin)
    start = energy_of_pairs(world)
    world.step(3 * rate)
    np.testing.assert_allclose(energy_of_pairs(world), start, rtol=1e-8)
    if not turned:
        speeds = np.array([1 + index % 10 for index in range(count)])
        # They have met, and each has the velocity of the other.
        np.testing.assert_allclose(world.velocities[::2, 0], -0.5 * speeds, rtol=1e-8)


def energy_of_pairs(world: World) -> np.ndarray:
    """The kinetic energy of each two cubes that were thrown one after the other, J."""
    v, w = world.velocities[:, :3], world.velocities[:, 3:]
    return (0.5 * (v * v).sum(1) + 0.5 * INERTIA * (w * w).sum(1)).reshape(-1, 2).sum(1)


@pytest.mark.parametrize('gap', [1e-3, 0.1])
def test_a_row_of_elastic_cubes_hands_an_impact_to_its_end(gap):
    world = World(settings(500, gravity=0.0, restitution=1.0, friction=0.0))
    for index in range(5):
        world.throw(((0.5 + gap) * index, 0.0, 50.0), FLAT)
    world.throw((-2.0, 0.0, 50.0), FLAT, (2.0, 0.0, 0.0))
    world.step(1000)
    np.testing.assert_allclose(world.velocities[:, 0], [0, 0, 0, 0, 2, 0], atol=1e-6)


def test_a_gas_of_elastic_cubes_keeps_its_energy():
    draw = Draw(27)
    world = World(settings(500, gravity=0.0, restitution=1.0, friction=0.0))
    for index in range(64):
        place = (index // 16, index // 4 % 4, 100 + index % 4)
        world.throw(place, draw.orientation(), draw.vector(-3.0, 3.0), draw.vector(-3.0, 3.0))
    start = energy_of_pairs(world).sum()
    impacts = 0
    for _ in range(1000):
        world.step()
        impacts += world.counters['impacts']
    assert impacts > 50
    assert energy_of_pairs(world).sum() == pytest.approx(start, rel=1e-6)


def test_cubes_that_touch_do_not_sleep_in_mid_air():
    world = World(settings(gravity=0.01))
    world.throw((0.0, 0.0, 5.0), FLAT)
    world.throw((0.5, 0.0, 5.0), FLAT)
    world.step(2400)
    assert world.awake == 2
    np.testing.assert_allclose(world.poses[:, 2], 4.5, atol=1e-6)


@pytest.mark.parametrize('count', [2, 3, 10])
def test_cubes_in_one_place_at_rest_part_without_a_velocity(count):
    world = World(settings(gravity=0.0))
    world.throw(np.tile([0.0, 0.0, 50.0], (count, 1)), FLAT)
    world.step(1440)
    assert np.abs(world.velocities).max() < 1e-12
    assert deepest(world)[1] < 1e-4
    assert world.awake == count


@pytest.mark.parametrize('rate', [60, 240, 1000])
@pytest.mark.parametrize(('restitution', 'height'), [(0.5, 1.0), (0.9, 0.5)])
@pytest.mark.parametrize('below', [1, 3, 9])
def test_a_cube_dropped_on_a_stack_rebounds_as_from_the_plane(below, restitution, height, rate):
    # What carries the one that is hit holds it: rebound e^2 h. The apex lies between two steps, and
    # through a high stack the impact is not quite solved out.
    world = World(settings(rate, restitution=restitution, sleep=False))
    for level in range(below):
        world.throw((0.0, 0.0, 0.25 + 0.5 * level), FLAT)
    world.step(rate // 4)
    world.throw((0.0, 0.0, 0.25 + 0.5 * below + height), FLAT)
    speed, turned_back = 0.0, False
    for _ in range(2 * rate):
        world.step()
        speed = world.velocities[below, 2]
        turned_back = turned_back or speed > 0.3
        if turned_back and speed <= 0.0:
            break
    assert turned_back
    rebound = world.poses[below, 2] - 0.25 - 0.5 * below
    assert rebound == pytest.approx(restitution**2 * height, rel=0.003 if below < 9 else 0.015)


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


def test_a_run_ends_in_the_golden_state_for_any_batching_and_threads():
    (digest,) = {
        run(World(settings(), threads=threads), batch)
        for threads, batch in ((1, 1), (1, 240), (3, 30))
    }
    assert digest == GOLDEN['contact']


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


def test_sleepers_that_are_near_and_never_touched_have_their_contacts_with_the_plane():
    world = World(settings())
    world.throw((0.0, 0.0, 0.25), FLAT)
    world.throw((0.53, 0.0, 0.25), FLAT)
    world.step(480)
    assert world.awake == 0
    assert world.counters['near_pairs'] == 1
    points = world.contact_points
    assert sorted(map(tuple, points.cubes)) == [(0, -1)] * 4 + [(1, -1)] * 4


@pytest.mark.parametrize('sleep', [False, True])
def test_the_contact_points_carry_the_weight(sleep):
    world = World(settings(sleep=sleep))
    for level in range(3):
        world.throw((0.0, 0.0, 0.25 + 0.5 * level), FLAT)
    world.step(480)
    assert world.awake == (0 if sleep else 3)
    points = world.contact_points
    assert set(map(tuple, points.cubes)) == {(0, -1), (0, 1), (1, 2)}
    weight = 9.81 / 240
    for pair, load in (((0, -1), 3.0), ((0, 1), -2.0), ((1, 2), -1.0)):
        chosen = (points.cubes == pair).all(axis=1)
        total = points.impulses[chosen].sum(axis=0)
        assert total[2] == pytest.approx(load * weight, rel=1e-3)
    np.testing.assert_allclose(np.abs(points.normals[:, 2]), 1.0, atol=1e-6)
    assert len(points.cubes) == 12
    heights = {(0, -1): 0.0, (0, 1): 0.5, (1, 2): 1.0}
    expected = [heights[tuple(pair)] for pair in points.cubes]
    np.testing.assert_allclose(points.positions[:, 2], expected, atol=1e-4)
    if not sleep:
        assert world.counters['touching_pairs'] == 3
