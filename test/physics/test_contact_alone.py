"""The model `contact`, one cube and the plane: each law against its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.physics_states import Draw, crowd, thrown

from cube_sim.physics import Settings, World
from cube_sim.physics.contact.corners import (
    HEIGHT,
    JN,
    JX,
    JY,
    PART,
    bounce,
    energy,
    place_corners,
)
from cube_sim.physics.contact.rules import rules_of

# 240 steps a second, the rate of the peers' figures.
RATE = 240
FLAT = (0.0, 0.0, 0.0, 1.0)


def settings(**changes) -> Settings:
    values = {'model': 'contact', 'cube_size': 0.5, 'time_step_ns': round(1e9 / RATE), **changes}
    return Settings(**values)


@pytest.mark.parametrize('restitution', [0.0, 0.3, 0.5, 0.9, 1.0])
def test_a_flat_drop_of_a_metre_rebounds_to_e_squared(restitution):
    world = World(settings(restitution=restitution))
    world.throw((0.0, 0.0, 1.25), FLAT)
    world.step(130)  # the impact is at 0.4515 s, step 108
    height, speed = world.poses[0, 2] - 0.25, world.velocities[0, 2]
    apex = height + speed * speed / (2.0 * 9.81)
    assert apex == pytest.approx(restitution**2, abs=1e-9)
    assert np.abs(world.velocities[0, 3:]).max() < 1e-12


def test_a_bouncing_cube_comes_to_rest_when_the_series_of_bounces_ends():
    world = World(settings())
    world.throw((0.0, 0.0, 1.25), FLAT)
    end = math.sqrt(2.0 / 9.81) * 1.5 / 0.5
    world.step(round((end - 0.02) * RATE))
    assert world.velocities[0, 2] != 0.0
    world.step(round(0.04 * RATE))
    assert np.all(world.velocities == 0.0)
    assert world.poses[0, 2] == pytest.approx(0.25, abs=1e-9)


def test_a_sliding_cube_stops_after_the_closed_form():
    world = World(settings())
    world.throw((0.0, 0.0, 0.25), FLAT, (3.0, 0.0, 0.0))
    world.step(RATE)
    assert world.poses[0, 0] == pytest.approx(9.0 / (2.0 * 0.5 * 9.81), rel=1e-3)
    assert np.all(world.velocities == 0.0)


@pytest.mark.parametrize('direction', [0.0, 0.3, 0.8, 2.0])
def test_friction_is_as_strong_in_every_direction(direction):
    world = World(settings())
    x, y = math.cos(direction), math.sin(direction)
    world.throw((0.0, 0.0, 0.25), FLAT, (3.0 * x, 3.0 * y, 0.0))
    world.step(RATE)
    distance = 9.0 / (2.0 * 0.5 * 9.81)
    np.testing.assert_allclose(world.poses[0, :2], [distance * x, distance * y], atol=1e-3)


@pytest.mark.parametrize(('share', 'holds'), [(0.99, True), (1.01, False)])
def test_a_tilted_plane_holds_below_the_angle_of_friction_and_not_above(share, holds):
    angle = math.atan(0.5 * share)
    direction = (math.sin(angle), 0.0, -math.cos(angle))
    world = World(settings(gravity_direction=direction))
    world.throw((0.0, 0.0, 0.25), FLAT)
    world.step(60 * RATE)
    distance = math.hypot(world.poses[0, 0], world.poses[0, 1])
    if holds:
        assert distance < 1e-6
    else:
        slide = 0.5 * 9.81 * (math.sin(angle) - 0.5 * math.cos(angle)) * 60.0**2
        assert distance == pytest.approx(slide, rel=1e-3)


def impact(draw: Draw, restitution: float, friction: float):
    """A random impact of one corner: the cube before and after it, and its corner."""
    rules = rules_of(
        settings(restitution=restitution, friction=friction, restitution_threshold=0.0, gravity=0)
    )
    while True:
        cube, corners, spare = np.zeros(13), np.zeros((8, 32)), np.zeros(32)
        cube[3:7] = draw.orientation()
        cube[7:10], cube[10:] = draw.vector(-5.0, 5.0), draw.vector(-10.0, 10.0)
        cube[2] -= place_corners(cube, 0.25, corners)
        place_corners(cube, 0.25, corners)
        before = cube.copy()
        bounce(cube, rules, corners, 1e-9, spare)
        (touching,) = np.nonzero(corners[:, PART])
        if len(touching) == 1 and corners[touching[0], JN] > 0.0:
            return before, cube, corners[touching[0]], rules


def point_velocity(cube, corner):
    return cube[7:10] + np.cross(cube[10:13], corner[:3])


@pytest.mark.parametrize('friction', [0.0, 0.3, 1.0, 10.0])
@pytest.mark.parametrize('restitution', [0.0, 0.5, 1.0])
def test_a_corner_impact_is_newtons_and_coulombs(restitution, friction):
    draw = Draw(round(10 * restitution + 100 * friction))
    seen = set()
    for _ in range(60):
        before, after, corner, rules = impact(draw, restitution, friction)
        r, j = corner[:3], corner[[JX, JY, JN]]
        u, v = point_velocity(before, corner), point_velocity(after, corner)
        w = rules.inverse_inertia
        k = (1.0 + w * r @ r) * np.eye(3) - w * np.outer(r, r)
        np.testing.assert_allclose(v, u + k @ j, atol=1e-9)
        assert v[2] == pytest.approx(-restitution * u[2], abs=1e-9)
        slip, push = math.hypot(*v[:2]), math.hypot(*j[:2])
        assert push <= friction * j[2] * (1.0 + 1e-9) + 1e-12
        gained = energy(after, w) - energy(before, w)
        assert gained <= 1e-12 * energy(before, w)
        stick = np.linalg.solve(k, [-u[0], -u[1], -(1.0 + restitution) * u[2]])
        if abs(gained) < 1e-9 * energy(before, w) and restitution < 1.0:
            continue  # the friction was scaled so that the energy stays
        if math.hypot(*stick[:2]) <= friction * stick[2] and restitution < 1.0:
            np.testing.assert_allclose(j, stick, rtol=1e-9, atol=1e-9)
            seen.add('sticks')
        elif restitution < 1.0 and friction > 0.0:
            assert push == pytest.approx(friction * j[2], rel=1e-9)
            np.testing.assert_allclose(j[:2] * slip, -v[:2] * push, atol=1e-8)
            seen.add('slides')
    if restitution < 1.0 and friction in (0.3, 1.0):
        assert seen == {'sticks', 'slides'}


def test_no_impact_gains_energy():
    draw = Draw(5)
    for _ in range(1500):
        restitution = (0.0, 0.5, 1.0)[int(draw.number(0.0, 3.0))]
        before, after, _, rules = impact(draw, restitution, draw.number(0.0, 3.0))
        start = energy(before, rules.inverse_inertia)
        assert energy(after, rules.inverse_inertia) <= start * (1.0 + 1e-12)


def test_elastic_cubes_keep_their_energy():
    world = World(
        settings(restitution=1.0, friction=0.0, collide_cubes=False, time_step_ns=1_000_000)
    )
    draw = Draw(6)
    for _ in range(49):
        world.throw((0.0, 0.0, 3.0), draw.orientation())
    start = 9.81 * 3.0
    world.step(20_000)
    v, w = world.velocities[:, :3], world.velocities[:, 3:]
    now = 0.5 * (v * v).sum(1) + 0.5 * (0.25 / 6.0) * (w * w).sum(1) + 9.81 * world.poses[:, 2]
    assert math.sqrt(np.mean((now / start - 1.0) ** 2)) < 1e-12
    assert world.contacts > 1000


@pytest.mark.parametrize('sleep', [False, True])
def test_a_thousand_thrown_cubes_come_to_an_exact_rest(sleep):
    world = thrown(settings(collide_cubes=False, sleep=sleep), crowd(1000, seed=7))
    world.step(10 * RATE)
    still = np.abs(world.velocities).max(axis=1) == 0.0
    fast = np.array([index % 8 == 5 for index in range(1000)])  # thrown at up to 17000 rad/s
    assert still[~fast].all()
    poses = world.poses[still].copy()
    world.step(RATE)
    assert world.poses[still].tobytes() == poses.tobytes()
    assert heights(world).min() > -1e-4


def heights(world: World) -> np.ndarray:
    """The height of the lowest corner of each cube, m."""
    x, y, z, w = world.poses[:, 3:].T
    up = np.abs([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)])
    return world.poses[:, 2] - 0.5 * world.settings.cube_size * up.sum(axis=0)


def test_corners_are_placed_where_the_cube_is():
    cube, corners = np.zeros(13), np.zeros((8, 32))
    cube[2], cube[6] = 0.25, 1.0
    assert place_corners(cube, 0.25, corners) == 0.0
    assert sorted(corners[:, HEIGHT]) == [0.0] * 4 + [0.5] * 4
