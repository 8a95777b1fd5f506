"""Every step of the report's two models against the plain reference of `physics_reference`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support import physics_reference as reference
from support.physics_states import Draw

from cube_sim.physics import Settings, World

MODELS = ('simple', 'impulse')
VARIANTS = (
    {},
    {'restitution': 0.0, 'friction': 0.0, 'tangential_factor': 0.0},
    {'restitution': 1.0, 'friction': 10.0, 'tangential_factor': 1.0, 'cube_size': 2.5},
    {'gravity_direction': (0.48, 0.6, -0.64), 'time_step_ns': 20_000_000, 'friction': 0.05},
)

# Half of a unit in the last place is 1.1e-16. The depths that weight the corners are differences
# of numbers of about 1 and of a millimetre or more: relative errors of 1e-13 in the contact point,
# which the inverse inertia, at most 24/m^2, and speeds of some 10 m/s carry to the velocities.
POSE_TOLERANCE = 2e-14
VELOCITY_TOLERANCE = 2e-11


def laws_of(settings: Settings) -> reference.Laws:
    return reference.Laws(
        settings.model,
        settings.time_step_ns / 1e9,
        settings.cube_size,
        settings.gravity * np.array(settings.gravity_direction),
        settings.restitution,
        settings.friction,
        settings.tangential_factor,
    )


def penetrating_states(laws: reference.Laws, count: int, seed: int):
    """States of which one step leads some corners below the plane, by a millimetre or more."""
    draw = Draw(seed)
    states = []
    for index in range(count):
        q = np.array(draw.orientation())
        # Turned about one axis only: an edge comes first. Not at all: a face does.
        if index % 4 == 1:
            q = np.array([math.sin(0.5 * draw.number(0, 1)), 0, 0, 0])
            q[3] = math.sqrt(1 - q[0] ** 2)
        if index % 16 == 2:
            q = np.array([0.0, 0.0, 0.0, 1.0])
        v = np.array(draw.vector(-8.0, 8.0))
        w = np.array(draw.vector(-12.0, 12.0))
        if index % 32 == 2:
            w = np.zeros(3)
        if index % 64 == 2:
            v[:2] = 0.0
        p = np.array([*draw.vector(-3.0, 3.0, 2), 0.0])
        after = reference.moved(laws, p, q, v, w)
        lowest = reference.corners(after[0], after[1], laws.side)[:, 2].min()
        p[2] -= lowest + draw.number(0.001, 1.3 * laws.side)
        states.append((p, q, v, w))
    return states


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('variant', VARIANTS, ids=['default', 'low', 'high', 'tilted'])
def test_a_step_with_contact_is_that_of_the_reference(model, variant):
    settings = Settings(model=model, **variant)
    laws = laws_of(settings)
    states = penetrating_states(laws, 400, seed=11)
    world = World(settings)
    world.throw(*(np.array(column) for column in zip(*states, strict=True)))
    world.step()
    assert world.contacts == len(states)

    touching, rising, clamped, free = 0, 0, 0, 0
    for index, (p, q, v, w) in enumerate(states):
        p1, q1, v1, w1 = reference.stepped(laws, p, q, v, w)
        np.testing.assert_allclose(
            world.poses[index], [*p1, *q1], rtol=0, atol=POSE_TOLERANCE, err_msg=str(index)
        )
        np.testing.assert_allclose(
            world.velocities[index],
            [*v1, *w1],
            rtol=0,
            atol=VELOCITY_TOLERANCE,
            err_msg=str(index),
        )
        # What the states were made for does happen among them.
        pm, qm, vm, wm = reference.moved(laws, p, q, v, w)
        points = reference.corners(pm, qm, laws.side)
        touching = max(touching, int((points[:, 2] < 0).sum()))
        rising += bool(np.array_equal(vm, v1) and np.array_equal(wm, w1))
        drop = np.hypot(*(v1 - vm)[:2])
        clamped += bool(drop > 0 and abs(drop - abs(v1[2] - vm[2])) < 1e-12 * drop)
        free += bool(0 < drop < (1 - 1e-9) * abs(v1[2] - vm[2]))
    assert touching == 8
    assert rising >= 40
    if model == 'impulse' and laws.friction > 0:
        assert clamped >= (20 if laws.friction > 0.1 else 0)
        assert free >= (20 if laws.friction < 5 else 0)


@pytest.mark.parametrize('model', MODELS)
def test_a_whole_fall_is_that_of_the_reference_step_by_step(model):
    # Each step starts from the product's own state, so that only the error of one step counts;
    # steps whose corners are less than 1e-6 m deep weight them too uncertainly to compare.
    settings = Settings(model=model, time_step_ns=5_000_000)
    laws = laws_of(settings)
    draw = Draw(12)
    world = World(settings)
    for _ in range(6):
        world.throw(
            [0, 0, draw.number(0.5, 1.5)],
            draw.orientation(),
            draw.vector(-3.0, 3.0),
            draw.vector(-9.0, 9.0),
        )
    compared = 0
    for _ in range(250):
        poses, velocities = world.poses.copy(), world.velocities.copy()
        world.step()
        for i in range(len(world)):
            state = poses[i, :3], poses[i, 3:], velocities[i, :3], velocities[i, 3:]
            depth, _ = reference.contact(laws, *reference.moved(laws, *state)[:2])
            if 0.0 < depth < 1e-6:
                continue
            p, q, v, w = reference.stepped(laws, *state)
            np.testing.assert_allclose(world.poses[i], [*p, *q], rtol=0, atol=POSE_TOLERANCE)
            np.testing.assert_allclose(world.velocities[i], [*v, *w], rtol=0, atol=1e-8)
            compared += depth > 0
    assert compared >= 50


@pytest.mark.parametrize('model', MODELS)
def test_a_rising_cube_is_pushed_out_and_not_thrown_down(model):
    # The corner at +x swings below the plane while its contact point rises, too: pushed out by
    # its depth, the velocities keep every bit.
    world = World(Settings(model=model, gravity=0.0))
    tilt = math.radians(10)
    q = (0.0, math.sin(tilt / 2), 0.0, math.cos(tilt / 2))
    world.throw((0, 0, 0.2), q, (1.0, 0.5, 4.0), (0.0, -0.5, 0.25))
    before = world.velocities.tobytes()
    world.step()
    assert world.contacts == 1
    assert world.velocities.tobytes() == before
    lowest = reference.corners(world.poses[0, :3], world.poses[0, 3:], 0.5)[:, 2].min()
    assert abs(lowest) <= 1e-15


def test_impulse_asks_whether_the_contact_point_approaches_and_not_the_centre():
    # The centre rises at 1 m/s, but the only penetrating corner sinks at w r - 1 m/s.
    settings = Settings(model='impulse', gravity=0.0, restitution=0.5, friction=0.0)
    world = World(settings)
    tilt = math.radians(20)
    q = np.array([0.0, math.sin(tilt / 2), 0.0, math.cos(tilt / 2)])
    world.throw((0, 0, 0.3), q, (0.0, 0.0, 1.0), (0.0, 9.0, 0.0))
    world.step()
    assert world.contacts == 1
    assert world.velocities[0, 2] > 1.0
    assert world.velocities[0, 4] < 9.0


@pytest.mark.parametrize(
    ('speed', 'rubs'), [(0.0, False), (0.9e-12, False), (1.1e-12, True), (1e-6, True)]
)
def test_no_friction_impulse_below_the_least_sliding_speed(speed, rubs):
    # The page: no tangential impulse when the sliding velocity is shorter than 1e-12 m/s.
    world = World(Settings(model='impulse', gravity=0.0))
    world.throw((0, 0, 0.249), (0, 0, 0, 1), (0.0, -speed, -1.0), (0, 0, 0))
    world.step()
    vx, vy, vz, wx, wy, wz = world.velocities[0]
    assert (vx, vz, wy, wz) == (0.0, 0.5, 0.0, 0.0)
    assert (vy != -speed) == rubs
    assert (wx != 0.0) == rubs


def test_simple_leaves_a_cube_alone_that_does_not_sink():
    # v_z = 0 is not < 0: the sliding velocity is not damped either.
    world = World(Settings(model='simple', gravity=0.0))
    world.throw((0, 0, 0.2), (0, 0, 0, 1), (2.0, 1.0, 0.0), (0, 0, 0))
    world.step()
    assert world.velocities[0].tolist() == [2.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    assert world.poses[0, 2] == 0.25


def test_a_corner_that_only_touches_the_plane_is_no_contact():
    # d > 0 is needed: z = 0 exactly does not penetrate.
    world = World(Settings(model='simple', gravity=0.0))
    world.throw((0, 0, 0.5), (0, 0, 0, 1), (1.0, 0.0, -0.25 / 0.002), (0, 0, 0))
    world.step()
    assert world.poses[0, 2] == 0.25
    assert world.contacts == 0
    world.step()
    assert world.contacts == 1
    assert world.velocities[0].tolist() == [0.9, 0.0, 62.5, 0.0, 0.0, 0.0]
