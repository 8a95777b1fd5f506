"""Settings: one declaration for each, checked when they are made."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cube_sim.physics import MODELS, PhysicsError, Settings
from cube_sim.physics.models import model_named, next_model

NUMBERS = ('restitution', 'friction', 'tangential_factor', 'gravity', 'cube_size')


def test_the_defaults_are_the_documented_ones():
    documented = {
        'model': 'simple',
        'restitution': 0.5,
        'friction': 0.5,
        'tangential_factor': 0.9,
        'gravity': 9.81,
        'gravity_direction': (0.0, 0.0, -1.0),
        'cube_size': 0.5,
        'time_step_ns': 2_000_000,
    }
    assert documented.items() <= dataclasses.asdict(Settings()).items()


@pytest.mark.parametrize('name', NUMBERS)
def test_a_number_is_taken_up_to_its_limits_and_refused_beyond(name):
    declared = Settings.__dataclass_fields__[name].metadata['quantity']
    assert declared.effect
    for value in (declared.low, declared.high):
        assert getattr(Settings(**{name: value}), name) == value
    for value in (
        math.nextafter(declared.low, -math.inf),
        math.nextafter(declared.high, math.inf),
        math.nan,
        math.inf,
        -math.inf,
        True,
        '0.5',
        None,
        [0.5],
    ):
        with pytest.raises(PhysicsError, match=f'{name} is .*: a finite number from .* is needed'):
            Settings(**{name: value})


def test_whole_numbers_become_floats():
    settings = Settings(gravity=10, restitution=1)
    assert type(settings.gravity) is float
    assert type(settings.restitution) is float


@pytest.mark.parametrize('value', [0, 999, 100_000_001, 2e6, True, '2', None])
def test_a_time_step_is_a_whole_number_of_nanoseconds_in_range(value):
    with pytest.raises(PhysicsError, match=r'time_step_ns is .* needed'):
        Settings(time_step_ns=value)


def test_a_time_step_in_seconds_is_the_nearest_float():
    assert Settings(time_step_ns=2_000_000).time_step == 0.002
    assert Settings(time_step_ns=1_000).time_step == 1e-6
    assert Settings(time_step_ns=100_000_000).time_step == 0.1


@pytest.mark.parametrize('name', ['clay', '', 'Simple', None, 3, ['simple'], {}])
def test_an_unknown_model_is_refused_with_the_list_of_those_there_are(name):
    with pytest.raises(PhysicsError) as refused:
        Settings(model=name)
    assert str(refused.value).endswith(f'there are: {", ".join(MODELS)}.')
    assert repr(name) in str(refused.value)


def test_every_model_has_its_own_code_and_the_next_one_goes_round():
    assert list(MODELS)[:2] == ['simple', 'impulse']
    assert len({model.code for model in MODELS.values()}) == len(MODELS)
    assert all(model_named(name).summary for name in MODELS)
    name, seen = 'simple', []
    for _ in MODELS:
        seen.append(name)
        name = next_model(name)
    assert seen == list(MODELS)
    assert name == 'simple'


def test_an_unknown_setting_is_refused_with_the_list_of_those_there_are():
    with pytest.raises(PhysicsError) as refused:
        Settings().changed(gravitas=1)
    for field in dataclasses.fields(Settings):
        assert field.name in str(refused.value)


def test_changed_settings_are_others_and_the_first_stay():
    settings = Settings()
    assert settings.changed(friction=0.1).friction == 0.1
    assert settings == Settings()


@pytest.mark.parametrize(
    'direction',
    [(0, 0, 0), (0, 0), (0, 0, 0, 1), (0, 0, math.nan), (math.inf, 0, 0), 'down', 1, None],
)
def test_a_direction_of_gravity_that_is_none_is_refused(direction):
    with pytest.raises(PhysicsError, match=r'gravity_direction is .* needed'):
        Settings(gravity_direction=direction)


DIRECTION = st.tuples(*[st.floats(-1.0, 1.0)] * 3) | st.tuples(*[st.floats(-1e5, 1e5)] * 3)


@given(DIRECTION)
@hypothesis_settings(derandomize=True, max_examples=300)
def test_a_direction_of_gravity_is_normalised_once_and_for_all(direction):
    # To the bit, so that a recorded direction read back is the one that was used; and the
    # components are in their declared range.
    assume(math.hypot(*direction) > 1e-5)
    once = Settings(gravity_direction=direction).gravity_direction
    assert Settings(gravity_direction=once).gravity_direction == once
    assert math.hypot(*once) == pytest.approx(1.0, abs=1.5e-15)
    assert all(-1.0 <= component <= 1.0 for component in once)
    length = math.hypot(*direction)
    assert once == pytest.approx([component / length for component in direction], abs=2e-15)


def test_the_constants_of_a_step_follow_from_the_settings():
    # gain = g d dt, half = c/2, 1/I = 6/c^2.
    settings = Settings(
        restitution=0.25,
        friction=0.75,
        tangential_factor=0.5,
        gravity=8.0,
        gravity_direction=(0.0, 0.6, -0.8),
        cube_size=2.0,
        time_step_ns=62_500_000,
    )
    constants = settings.constants()
    assert constants.time_step == 0.0625
    assert (constants.gain_x, constants.half_side, constants.inverse_inertia) == (0.0, 1.0, 1.5)
    assert constants.gain_y == pytest.approx(0.3, rel=3e-16)
    assert constants.gain_z == pytest.approx(-0.4, rel=3e-16)
    assert constants[-3:] == (0.25, 0.75, 0.5)
