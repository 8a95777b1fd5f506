"""What a World takes, what it refuses, and what it shows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cube_sim.physics import MODELS, PhysicsError, Settings, World
from cube_sim.physics.world import (
    POSITION_LIMIT,
    SPIN_LIMIT,
    VELOCITY_LIMIT,
    turned_by,
    unit_quaternions,
)

UP = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def world() -> World:
    made = World(Settings())
    made.throw((1, 2, 3), UP, (4, 5, 6), (7, 8, 9))
    return made


def test_a_world_begins_empty_at_time_0():
    world = World()
    assert (len(world), world.steps, world.time_ns, world.contacts) == (0, 0, 0, 0)
    assert world.poses.shape == (0, 7)
    assert world.velocities.shape == (0, 6)
    assert world.settings == Settings()
    assert world.settings.model in MODELS


def test_a_throw_puts_one_cube_where_it_is_told(world):
    assert world.poses.tolist() == [[1, 2, 3, 0, 0, 0, 1]]
    assert world.velocities.tolist() == [[4, 5, 6, 7, 8, 9]]
    assert world.poses.dtype == world.velocities.dtype == np.float64


def test_a_throw_answers_the_index_of_its_first_cube():
    world = World()
    assert world.throw((0, 0, 1), UP) == 0
    assert world.throw(np.zeros((5, 3)), UP) == 1
    assert world.throw([(0, 0, 1)], [UP], [(0, 0, 0)], [(0, 0, 0)]) == 6
    assert len(world) == 7


def test_without_velocities_a_cube_is_at_rest():
    world = World()
    world.throw((0, 0, 1), UP)
    assert world.velocities.tolist() == [[0] * 6]


def test_one_row_serves_all():
    world = World()
    positions = np.arange(12.0).reshape(4, 3)
    spins = [(1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0)]
    world.throw(positions, UP, [(1, 2, 3)], spins)
    assert world.poses.tolist() == [[*p, *UP] for p in positions.tolist()]
    assert world.velocities.tolist() == [[1, 2, 3, *spin] for spin in spins]


def test_many_cubes_at_once_are_the_same_as_one_after_the_other():
    # More than the memory that a world begins with, twice.
    rows = np.arange(40 * 3.0).reshape(40, 3)
    once, each = World(), World()
    once.throw(rows, UP, -rows, rows)
    for index, row in enumerate(rows):
        assert each.throw(row, UP, -row, row) == index
    once.step(3)
    each.step(3)
    assert once.digest() == each.digest()


def test_what_is_thrown_is_copied():
    world = World()
    position = np.array([1.0, 2.0, 3.0])
    world.throw(position, UP)
    position[:] = 9.0
    assert world.poses[0, :3].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (((1, 2), UP), r'position has shape \(2,\): \(3,\) or \(N, 3\) is needed'),
        ((np.zeros((2, 2, 3)), UP), r'position has shape \(2, 2, 3\)'),
        ((5.0, UP), r'position has shape \(\)'),
        (((1, 2, 3), (0, 0, 1)), r'orientation has shape \(3,\): \(4,\) or \(N, 4\)'),
        (((1, 2, 3), UP, (1, 2, 3, 4)), r'velocity has shape \(4,\)'),
        (((1, 2, 3), UP, (1, 2, 3), ()), r'spin has shape'),
        (('abc', UP), "position is 'abc': numbers are needed"),
        ((None, UP), 'position'),
        (((1, 2, (3, 4)), UP), 'position is .*: numbers are needed'),
        (((1, 2, 3j), UP), 'position is .*: numbers are needed'),
        (((1, 2, float('nan')), UP), 'position has nan: finite numbers are needed'),
        (((1, 2, float('-inf')), UP), 'position has -inf: finite numbers are needed'),
        (((1, 2, 1.01e7), UP), r'position has 1.01e\+07: at most 1e\+07 m is meaningful'),
        (((1, 2, 3), UP, (-1.01e5, 0, 0)), r'velocity has -101000: at most 100000 m/s'),
        (((1, 2, 3), UP, (1, 2, 3), (0, 0, 1.01e5)), 'spin has 101000: at most 100000 rad/s'),
        (((1, 2, 3), (0, 0, 0, 0)), 'orientation is zero'),
        (((1, 2, 3), (1e-7, 0, 0, 1e-8)), 'orientation is zero'),
        (((1, 2, 3), (0, 0, 0, float('inf'))), 'orientation has inf'),
        (([(1, 2, 3)] * 3, [UP, (0, 0, 0, 0), UP]), 'orientation is zero'),
        (([(1, 2, 3)] * 3, [UP] * 2), 'as many rows everywhere, or one for all; it has 3, 2, 1, 1'),
        (([(1, 2, 3)] * 3 + [(1, 2, float('nan'))], UP), 'position has nan'),
    ],
)
def test_a_throw_that_cannot_be_is_refused_and_adds_nothing(world, arguments, message):
    before = world.digest()
    with pytest.raises(PhysicsError, match=message):
        world.throw(*arguments)
    assert world.digest() == before
    assert len(world) == 1


def test_the_limits_themselves_can_be_thrown_and_computed(world):
    for sign in (-1, 1):
        world.throw(
            [sign * POSITION_LIMIT] * 3, UP, [sign * VELOCITY_LIMIT] * 3, [sign * SPIN_LIMIT] * 3
        )
    world.step(1000)
    assert np.isfinite(world.poses).all()
    assert np.isfinite(world.velocities).all()


def test_an_orientation_is_normalised():
    # Each component is divided by the length: three roundings.
    world = World()
    world.throw((0, 0, 1), (2.0, -4.0, 4.0, 8.0))
    np.testing.assert_allclose(world.poses[0, 3:], [0.2, -0.4, 0.4, 0.8], rtol=4e-16)
    world.throw((0, 0, 1), (0, 0, 0, -1e99))
    assert world.poses[1, 3:].tolist() == [0, 0, 0, -1]


def test_a_quaternion_of_unit_length_keeps_its_bits():
    # Those that a run itself produces, as they are read back from a recording.
    world = World()
    for i in range(200):
        world.throw((0, 0, 9), (i - 99.5, 3, 1, 2), (0, 0, 0), (i, 1, -2))
    world.step(50)
    recorded = world.poses[:, 3:].copy()
    again = World()
    again.throw((0, 0, 9), recorded)
    assert again.poses[:, 3:].tobytes() == recorded.tobytes()


COMPONENT = st.floats(-1e99, 1e99) | st.floats(-2.0, 2.0) | st.sampled_from([0.0, 1.0, 1e-5])


@given(st.lists(st.lists(COMPONENT, min_size=4, max_size=4), min_size=1, max_size=5))
@example([[0.0, 0.6, 0.0, 0.8 * (1.0 + 10.0**-k)] for k in range(8, 17)])
@hypothesis_settings(deadline=None, derandomize=True, max_examples=300)
def test_normalising_twice_is_normalising_once(rows):
    # To the bit: an orientation from a message is the one that was used. Also of columns that
    # lie otherwise in memory. The length is 1 to the rounding of a square, a root, a division.
    quaternions = np.array(rows)
    assume(np.all((quaternions**2).sum(axis=1) > 1e-11))
    once = unit_quaternions(quaternions)
    assert unit_quaternions(once).tobytes() == once.tobytes()
    assert unit_quaternions(np.asfortranarray(quaternions)).tobytes() == once.tobytes()
    for index in range(len(rows)):
        assert unit_quaternions(quaternions[index])[0].tobytes() == once[index].tobytes()
    assert np.abs(np.linalg.norm(once, axis=1) - 1.0).max() <= 2.5e-15
    assert quaternions.tolist() == rows


def test_turning_a_vector_is_multiplying_it_with_the_matrix_of_the_quaternion():
    # A quarter turn about z takes x to y; a half turn about x takes z to -z; to rounding.
    root = 0.5**0.5
    np.testing.assert_allclose(turned_by((0, 0, root, root), (3, 0, 1)), (0, 3, 1), atol=1e-15)
    np.testing.assert_allclose(turned_by((1, 0, 0, 0), (3, 4, 5)), (3, -4, -5), atol=1e-15)
    third = turned_by((0.5, 0.5, 0.5, 0.5), (1, 2, 3))
    assert third.tolist() == [3, 1, 2]


def test_time_is_a_count_of_steps():
    world = World(Settings(time_step_ns=3_333_333))
    for steps in (1, 0, 5, np.int64(7)):
        world.step(steps)
    assert world.steps == 13
    assert world.time_ns == 13 * 3_333_333
    assert type(world.time_ns) is int


def test_no_steps_change_nothing(world):
    before = world.digest()
    world.step(0)
    assert world.digest() == before


@pytest.mark.parametrize('steps', [-1, 1.0, '1', None, np.float64(2)])
def test_a_number_of_steps_that_is_none_is_refused(world, steps):
    before = world.digest()
    with pytest.raises(PhysicsError, match='a whole number from 0 on is needed'):
        world.step(steps)
    assert world.digest() == before


@pytest.mark.parametrize('threads', [0, -1, 1.5, '2', True, None])
def test_a_number_of_threads_that_is_none_is_refused(threads):
    with pytest.raises(PhysicsError, match='a whole number from 1 on is needed'):
        World(threads=threads)


def test_the_views_cannot_be_written_to(world):
    for view in (world.poses, world.velocities):
        with pytest.raises(ValueError, match='read-only'):
            view[0, 0] = 0.0


def test_the_views_show_every_change(world):
    before = world.poses.copy()
    world.step()
    assert not np.array_equal(world.poses, before)
    world.throw((0, 0, 1), UP)
    assert world.poses.shape == (2, 7)
    assert world.velocities.shape == (2, 6)
    world.reset()
    assert world.poses.shape == (0, 7)
    assert world.velocities.shape == (0, 6)


def test_a_reset_removes_the_cubes_and_time_goes_on(world):
    world.step(5)
    world.reset()
    assert len(world) == 0
    assert world.time_ns == 5 * 2_000_000
    world.step(2)
    assert world.steps == 7
    assert world.throw((0, 0, 1), UP) == 0
    assert world.poses.tolist() == [[0, 0, 1, 0, 0, 0, 1]]


def test_a_cube_after_a_reset_is_as_one_in_a_new_world(world):
    world.step(5)
    world.reset()
    fresh = World(Settings())
    fresh.step(5)
    for either in (world, fresh):
        either.throw((0, 0, 0.3), (0.1, 0.2, 0.3, 0.4), (1, 2, 3), (4, 5, 6))
        either.step(100)
    assert world.digest() == fresh.digest()


def test_contacts_are_counted_once_for_each_cube_and_step():
    # Two flat cubes that lie on the plane with e = 0 touch it in every step; one in the air never.
    world = World(Settings(restitution=0.0))
    world.throw([(0, 0, 0.25), (3, 0, 0.25), (0, 0, 50)], UP)
    world.step(10)
    assert world.contacts == 20


def test_settings_hold_from_the_next_step_on(world):
    # v = g t: two steps of 9.81, then two of 1, in a fall without contact.
    world.step(2)
    world.configure(gravity=1.0)
    world.step(2)
    assert world.velocities[0, 2] == pytest.approx(6 - 0.004 * 9.81 - 0.004, abs=1e-15)
    assert world.settings == Settings(gravity=1.0)


def test_the_model_can_change_in_flight():
    # The spin tells them apart: only impulse changes it.
    world = World(Settings(model='simple', restitution=1.0))
    world.throw((0, 0, 0.5), (0.1, 0.2, 0.3, 0.9), (1, 0, -1), (1, 2, 3))
    world.step(300)
    assert world.contacts > 0
    assert world.velocities[0, 3:].tolist() == [1, 2, 3]
    world.configure(model='impulse')
    world.step(500)
    assert world.velocities[0, 3:].tolist() != [1, 2, 3]


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'restitution': 1.5}, 'restitution is 1.5: a finite number from 0 to 1 is needed'),
        ({'gravity': 3.0, 'friction': -0.1}, 'friction is -0.1'),
        ({'gravity': 3.0, 'model': 'clay'}, "No physics model is called 'clay'"),
        ({'gravity': 3.0, 'colour': 1}, "No setting is called 'colour'; there are: model, "),
        ({'gravity': 3.0, 'time_step_ns': 1_000_000}, 'time_step_ns is fixed for a run'),
    ],
)
def test_a_configuration_that_cannot_be_is_refused_and_changes_nothing(world, changes, message):
    twin = World(Settings())
    twin.throw((1, 2, 3), UP, (4, 5, 6), (7, 8, 9))
    with pytest.raises(PhysicsError, match=message):
        world.configure(**changes)
    assert world.settings == Settings()
    for either in (world, twin):
        either.step(300)
    assert world.digest() == twin.digest()


def test_the_same_time_step_may_be_said_again(world):
    world.configure(time_step_ns=2_000_000, gravity=1.0)
    assert world.settings.gravity == 1.0
