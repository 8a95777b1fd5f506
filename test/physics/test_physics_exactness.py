"""The same bits for any batching, any number of threads, any company, and from plain Python."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from support.physics_golden import CUBES_LEFT, GOLDEN, STEPS, run_script
from support.physics_states import crowd, thrown
from support.plain_code import PlainCode

from cube_sim.physics import Settings, World
from cube_sim.physics import step as plain_step
from cube_sim.physics.contact import engine as contact_engine
from cube_sim.physics.models import model_named

MODELS = ('simple', 'impulse')


def batches(name: str):
    """Ways to take n steps with a world."""
    if name == 'one at a time':
        return lambda world, n: [world.step() for _ in range(n)]
    if name == 'seven at a time':
        return lambda world, n: [world.step(min(7, n - done)) for done in range(0, n, 7)]
    return lambda world, n: world.step(n)


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('batching', ['one at a time', 'seven at a time', 'all at once'])
@pytest.mark.parametrize('threads', [1, 2, 3, 5])
def test_a_run_ends_in_the_golden_state(model, batching, threads):
    take = batches(batching)
    world = World(Settings(model=model, time_step_ns=5_000_000), threads=threads)
    run_script(world, lambda n: take(world, n))
    assert world.steps == STEPS
    assert len(world) == CUBES_LEFT
    assert world.contacts > 5000
    assert world.digest() == GOLDEN[model]


@pytest.mark.parametrize('threads', [2, 3, 5])
@pytest.mark.parametrize('count', [255, 256, 257, 512, 513, 1281])
def test_every_cube_is_advanced_once_however_the_threads_share_them(threads, count):
    throws = crowd(count, seed=31)
    alone, shared = (thrown(Settings(model='impulse'), throws, threads=n) for n in (1, threads))
    alone.step(60)
    shared.step(60)
    assert shared.digest() == alone.digest()
    assert shared.contacts == alone.contacts > 0


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('tilted', [False, True])
def test_the_machine_code_gives_the_bits_of_the_laws_as_they_are_written(model, tilted):
    # The functions that numba compiles are plain Python here: CPython rounds each operation once.
    direction = (0.36, -0.48, -0.8) if tilted else (0.0, 0.0, -1.0)
    settings = Settings(model=model, time_step_ns=5_000_000, gravity_direction=direction)
    world = thrown(settings, crowd(24, seed=32))
    state = np.concatenate([world.poses.T, world.velocities.T])
    numbers = np.array(settings.constants())
    scratch = np.empty((plain_step.SCRATCH_ROWS, plain_step.BLOCK))
    contacts = 0
    for _ in range(12):
        world.step(60)
        contacts += plain_step.advance(state, 0, 24, 60, model_named(model).code, numbers, scratch)
        assert world.poses.tobytes() == state[:7].T.tobytes()
        assert world.velocities.tobytes() == state[7:].T.tobytes()
    assert world.contacts == contacts > 500


def meeting_cubes(settings: Settings) -> World:
    """A stack, a fast cube that hits it, one that overlaps it, and one alone."""
    world = World(settings)
    for level in range(3):
        world.throw((0.0, 0.0, 0.25 + 0.5 * level), (0.0, 0.0, 0.1 * level, 1.0))
    world.throw((-1.3, 0.1, 0.6), (0.1, 0.2, 0.3, 0.9), (40.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    world.throw((0.3, 0.2, 1.6), (0.3, 0.0, 0.1, 0.9), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    world.throw((1.0, 3.0, 0.8), (0.1, 0.2, 0.3, 0.9), (1.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    return world


def test_the_machine_code_of_contact_gives_the_bits_of_its_laws_as_they_are_written(monkeypatch):
    # Few sweeps and an early sleep, so that plain Python comes through all of it in seconds.
    settings = Settings(model='contact', time_step_ns=4_000_000, solver_effort=0.5, sleep_delay=0.1)
    world = meeting_cubes(settings)
    monkeypatch.setattr(contact_engine, 'MachineCode', PlainCode)
    plain = meeting_cubes(settings)
    seen = {'impacts': 0, 'parts': 1, 'touching_pairs': 0}
    awake = set()
    for _ in range(100):
        world.step(10)
        for _ in range(10):
            plain.step()
            counters = plain.counters
            seen = {name: max(most, counters[name]) for name, most in seen.items()}
            awake.add(plain.awake)
        assert plain.digest() == world.digest()
        assert plain.counters == world.counters
    assert plain.contacts == world.contacts
    assert seen['impacts'] > 1
    assert seen['parts'] > 1
    assert seen['touching_pairs'] > 4
    assert max(awake) == 6
    assert min(awake) < 4


CROWD = crowd(330, seed=33)


@given(
    st.sampled_from(MODELS),
    st.lists(st.integers(0, 329), min_size=1, max_size=329, unique=True),
    st.booleans(),
)
@hypothesis_settings(max_examples=40, deadline=None, derandomize=True)
def test_the_bits_of_a_cube_do_not_depend_on_the_others_or_on_their_order(model, chosen, at_once):
    everyone = thrown(Settings(model=model), CROWD)
    everyone.step(150)
    if at_once:
        some = thrown(Settings(model=model), [CROWD[index] for index in chosen])
    else:
        some = World(Settings(model=model))
        for index in chosen:
            some.throw(*CROWD[index])
    some.step(150)
    assert some.poses.tobytes() == everyone.poses[chosen].tobytes()
    assert some.velocities.tobytes() == everyone.velocities[chosen].tobytes()


@pytest.mark.parametrize('model', MODELS)
def test_the_plane_is_the_same_everywhere(model):
    # Height, orientation and velocities do not know x and y: not a bit. x and y are shifted, up
    # to the rounding of 300 additions to numbers of up to 2^20 m.
    here = thrown(Settings(model=model), CROWD)
    shift = np.array([2.0**20, -(2.0**18) - 0.3, 0.0])
    there = thrown(
        Settings(model=model),
        [(list(np.add(position, shift)), *rest) for position, *rest in CROWD],
    )
    here.step(300)
    there.step(300)
    assert there.poses[:, 2:].tobytes() == here.poses[:, 2:].tobytes()
    assert there.velocities.tobytes() == here.velocities.tobytes()
    np.testing.assert_allclose(
        there.poses[:, :2], here.poses[:, :2] + shift[:2], rtol=0, atol=300 * 2.0**-32
    )


def test_the_digest_knows_time_count_and_every_bit_of_the_state():
    # Each variant differs in one thing only.
    def world(position=(0.0, 0.0, 5.0), spin=(0.0, 0.0, 1.0), count=1, steps=0) -> World:
        made = World(Settings(gravity=0.0))
        for _ in range(count):
            made.throw(position, (0, 0, 0, 1), (0, 0, 0), spin)
        made.step(steps)
        return made

    still = (0.0, 0.0, 0.0)
    variants = [
        world(),
        world(position=(0.0, 0.0, np.nextafter(5.0, 6.0))),
        world(spin=(0.0, 0.0, np.nextafter(1.0, 2.0))),
        world(count=2),
        world(spin=still),
        world(spin=still, steps=1),
    ]
    for one, other in itertools.combinations(variants, 2):
        assert one.digest() != other.digest()
    assert world().digest() == world().digest()
