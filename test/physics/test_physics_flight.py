"""Free flight: the parabola of semi-implicit Euler, and the torque-free spin."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from support.physics_states import Draw

from cube_sim.physics import Settings, World
from cube_sim.physics.rotation import SERIES_LIMIT, composed, cosine_and_sinc, rotor

EPSILON = 2.0**-52
MODELS = ('simple', 'impulse')


@pytest.mark.parametrize('model', MODELS)
def test_free_flight_is_the_parabola_to_the_last_bit_where_no_number_is_rounded(model):
    # p = p0 + v0 t - g t (t + dt) / 2. With a step of 2^-9 s and g, p0, v0 of few binary digits
    # every sum and product is exact, so nothing is left to tolerate.
    gravity, dt = 9.8125, 2.0**-9
    world = World(Settings(model=model, gravity=gravity, time_step_ns=1_953_125))
    p0, v0 = np.array([1.5, -2.25, 40.0]), np.array([3.5, -1.25, 6.75])
    world.throw(p0, (0, 0, 0, 1), v0, (0, 0, 0))
    for n in range(1, 701):
        world.step()
        t = n * dt
        fall = np.array([0.0, 0.0, gravity * t * (t + dt) / 2])
        assert world.poses[0, :3].tolist() == (p0 + v0 * t - fall).tolist()
        assert world.velocities[0, :3].tolist() == (v0 - [0.0, 0.0, gravity * t]).tolist()


@pytest.mark.parametrize('model', MODELS)
def test_free_flight_is_the_parabola_to_rounding_under_any_gravity(model):
    # p = p0 + v0 t + a t (t + dt) / 2. Each of the n steps rounds v and p once: at most n half
    # units in the last place of the largest speed, times t, and of the largest position.
    draw = Draw(3)
    for _ in range(20):
        direction = np.array(draw.vector(-1.0, 1.0))
        direction /= np.linalg.norm(direction)
        settings = Settings(model=model, gravity=7.3, gravity_direction=tuple(direction))
        world = World(settings)
        p0 = np.array([*draw.vector(-9.0, 9.0, 2), 500.0])
        v0 = np.array(draw.vector(-20.0, 20.0))
        world.throw(p0, draw.orientation(), v0, draw.vector(-5.0, 5.0))
        n = 1500
        world.step(n)
        t, acceleration = n * 0.002, 7.3 * direction
        expected = p0 + v0 * t + acceleration * t * (t + 0.002) / 2
        tolerance = n * EPSILON * (600.0 + 50.0 * t)
        np.testing.assert_allclose(world.poses[0, :3], expected, rtol=0, atol=tolerance)
        np.testing.assert_allclose(
            world.velocities[0, :3], v0 + acceleration * t, rtol=0, atol=n * EPSILON * 50.0
        )


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('speed', [0.0, 1e-9, 0.3, 7.0, 390.0, 394.0, 2e3, 99_999.0])
def test_a_spin_turns_by_its_speed_times_the_time_and_stays_what_it_is(model, speed):
    # q(t) = (sin(w t / 2) axis, cos(w t / 2)) q0 for any w: at 2^-8 s a step, 402 rad/s is the
    # quarter turn beyond which the series are not used. A step rounds the quaternion by less
    # than 4 units, and the half angle h of its rotor by less than 2 units of h.
    steps, dt = 200, 2.0**-8
    draw = Draw(4)
    axis = np.array(draw.vector(-1.0, 1.0))
    axis /= np.linalg.norm(axis)
    start = np.array(draw.orientation())
    world = World(Settings(model=model, gravity=0.0, time_step_ns=3_906_250))
    world.throw((0, 0, 9), start, (0, 0, 0), speed * axis)
    before = world.velocities.tobytes()
    world.step(steps)
    half = speed * steps * dt / 2
    turn = (*(math.sin(half) * axis), math.cos(half))
    tolerance = steps * EPSILON * (4 + 2 * speed * dt / 2)
    np.testing.assert_allclose(world.poses[0, 3:], composed(*turn, *start), rtol=0, atol=tolerance)
    assert world.velocities.tobytes() == before


def test_a_quaternion_keeps_its_length_for_ever():
    # Normalised in every step: three roundings of a half unit and those of four products.
    draw = Draw(5)
    world = World(Settings(gravity=0.0))
    for _ in range(300):
        spin = np.array(draw.vector(-1.0, 1.0)) * 10.0 ** draw.number(-3.0, 4.7)
        world.throw((0, 0, 9), draw.orientation(), (0, 0, 0), spin)
    world.step(5000)
    lengths = np.linalg.norm(world.poses[:, 3:], axis=1)
    assert np.abs(lengths - 1.0).max() <= 3 * EPSILON


def exact_cosine_and_sine(a: float) -> tuple[Decimal, Decimal]:
    """cos and sin of exactly that float, from their series with 80 digits."""
    with localcontext() as context:
        context.prec = 80
        # Machin: pi = 16 atan(1/5) - 4 atan(1/239).
        pi = 16 * _inverse_tangent(5) - 4 * _inverse_tangent(239)
        x = Decimal(a)
        x -= (x / (2 * pi)).to_integral_value() * 2 * pi
        return _series(x, Decimal(1)), _series(x, x)


def _inverse_tangent(n: int) -> Decimal:
    terms = [(-1) ** k / (Decimal(2 * k + 1) * Decimal(n) ** (2 * k + 1)) for k in range(58)]
    return sum(terms, Decimal(0))


def _series(x: Decimal, term: Decimal) -> Decimal:
    total, order = term, 0 if term == 1 else 1
    while abs(term) > Decimal(10) ** -70:
        term *= -x * x / ((order + 1) * (order + 2))
        total += term
        order += 2
    return total


# Angles of 25 binary digits: their squares are exact, and so are the roots of the squares.
ANGLES = st.integers(1, 5000 * 2**11).map(lambda n: n / 2**11) | st.integers(1, 2**25).map(
    lambda n: n / 2**24
)


@given(ANGLES)
@example(math.floor(math.sqrt(SERIES_LIMIT) * 2**20) / 2**20)
@example(math.ceil(math.sqrt(SERIES_LIMIT) * 2**20) / 2**20)
@example(0.75)
@example(1.5)
@example(2.25)
@example(4.0)
@example(5.5)
@example(7.0)
@hypothesis_settings(max_examples=150, deadline=None, derandomize=True)
def test_cosine_and_sine_are_right_to_two_units_for_any_angle(a):
    # On both sides of the series' limit and in all four quadrants. Two units in the last place
    # of 1, absolute: the reduced angle and the last two sums of the series round once each.
    cosine, sinc = cosine_and_sinc(a * a)
    exact_cosine, exact_sine = exact_cosine_and_sine(a)
    assert abs(Decimal(cosine) - exact_cosine) <= Decimal(2 * EPSILON)
    assert abs(Decimal(sinc) * Decimal(a) - exact_sine) <= Decimal(2 * EPSILON)
    if a * a <= SERIES_LIMIT:
        # Small angles are right relatively: a slow spin is as exact as a fast one.
        assert abs(Decimal(sinc) * Decimal(a) / exact_sine - 1) <= Decimal(1.5 * EPSILON)


def test_no_spin_turns_nothing():
    assert rotor(0.0, 0.0, 0.0, 0.002) == (0.0, 0.0, 0.0, 1.0)


def test_a_rotor_is_the_exponential_of_half_the_turn():
    # exp(w dt / 2) = (sin|h| h/|h|, cos|h|), h = w dt / 2, against libm, whose error is one unit.
    draw = Draw(6)
    for _ in range(2000):
        w = np.array(draw.vector(-1.0, 1.0)) * 10.0 ** draw.number(-6.0, 3.5)
        half = 0.5 * 0.002 * w
        angle = math.sqrt(half @ half)
        expected = [*(math.sin(angle) / angle * half), math.cos(angle)]
        np.testing.assert_allclose(rotor(*w, 0.002), expected, rtol=0, atol=6 * EPSILON)
