"""Closed forms of contact: rebounds, sliding, one impact; and the order of the integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support import physics_reference as reference
from support.physics_states import Draw

from cube_sim.physics import Settings, World

MODELS = ('simple', 'impulse')
GRAVITY = 9.81


def dropped(height: float, **settings) -> World:
    """A flat cube at rest whose lower face is `height` above the plane."""
    world = World(Settings(**settings))
    world.throw((0, 0, height + world.settings.cube_size / 2), (0, 0, 0, 1))
    return world


def bounces(world: World, count: int) -> tuple[list[float], list[float]]:
    """Times of the first `count` impacts, s, and the heights of the apexes after them, m."""
    times: list[float] = []
    apexes: list[float] = []
    apex, contacts = 0.0, 0
    while len(apexes) < count:
        world.step()
        if world.contacts > contacts:
            contacts = world.contacts
            if times:
                apexes.append(apex)
            times.append(world.time_ns / 1e9)
            apex = 0.0
        apex = max(apex, world.poses[0, 2] - world.settings.cube_size / 2)
    return times[:count], apexes


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('restitution', [0.3, 0.5, 0.8])
def test_the_first_rebound_misses_its_apex_by_a_first_order_error_of_known_size(model, restitution):
    # Dropped from h = g T^2 / 2 with T a whole number of steps, the cube lands in the middle of
    # step T/dt for every dt, at g T exactly. From then on z(t) = e g T t - g t (t + dt) / 2, whose
    # apex is e^2 h - e g T dt / 2 + g dt^2 / 8, less what sampling misses: at most g dt^2 / 8.
    fall = 0.48
    height = GRAVITY * fall**2 / 2
    steps_ns = (8_000_000, 4_000_000, 2_000_000, 1_000_000)
    errors = []
    for step_ns in steps_ns:
        world = dropped(height, model=model, restitution=restitution, time_step_ns=step_ns)
        times, (apex,) = bounces(world, 1)
        assert times == [pytest.approx(fall, abs=1e-12)]
        dt = step_ns / 1e9
        errors.append(restitution**2 * height - apex)
        # The cube rests on z = 0 at the impact, so its own 1e-15 of rounding is all there is.
        assert errors[-1] == pytest.approx(
            restitution * GRAVITY * fall * dt / 2, abs=GRAVITY * dt**2 / 8 + 1e-9
        )
    order = np.polyfit(np.log(steps_ns), np.log(errors), 1)[0]
    assert 0.95 < order < 1.05


@pytest.mark.parametrize('model', MODELS)
def test_apex_n_is_e_to_the_2n_of_the_height_and_impact_n_in_time(model):
    # Apex e^2n h, impact at T (1 + 2 e + ... + 2 e^(n-1)), T = sqrt(2 h / g). An impact is seen
    # up to dt late, when the cube is up to g dt too fast; then v_n+1 = e (v_n + err), so that no
    # impact speed is off by more than 2 g dt / (1 - e), and an impact time by n + 1 times
    # 2 * 2 dt / (1 - e). Both shrink with dt: the finest is held to a quarter of the coarsest.
    restitution, height = 0.7, 1.37
    fall = math.sqrt(2 * height / GRAVITY)
    for step_ns in (4_000_000, 2_000_000, 1_000_000):
        dt = step_ns / 1e9
        world = dropped(height, model=model, restitution=restitution, time_step_ns=step_ns)
        times, apexes = bounces(world, 6)
        speed_error = 2 * GRAVITY * dt / (1 - restitution)
        for n in range(1, 7):
            speed = restitution**n * GRAVITY * fall
            tolerance = (speed * speed_error + speed_error**2 / 2) / GRAVITY
            assert apexes[n - 1] == pytest.approx(restitution ** (2 * n) * height, abs=tolerance)
            due = fall * (1 + 2 * sum(restitution**k for k in range(1, n)))
            assert times[n - 1] == pytest.approx(due, abs=n * 4 * dt / (1 - restitution))


@pytest.mark.parametrize('model', MODELS)
def test_a_dropped_cube_is_near_rest_after_the_time_of_the_geometric_series(model):
    # All bounces together last sqrt(2 h / g) (1 + e) / (1 - e). Each of those higher than a
    # millimetre (e^2n h > 1 mm: n < 6) is up to 4 dt / (1 - e) off, and the tail, 2 T e^n / (1 - e)
    # long, is below it.
    restitution, height = 0.6, 0.8
    fall = math.sqrt(2 * height / GRAVITY)
    rest = fall * (1 + restitution) / (1 - restitution)
    world = dropped(height, model=model, restitution=restitution, time_step_ns=500_000)
    heights = []
    for _ in range(round(1.5 * rest / 0.0005)):
        world.step()
        heights.append(world.poses[0, 2] - 0.25)
    last = 0.0005 * (1 + max(i for i, height in enumerate(heights) if height > 1e-3))
    n = math.ceil(math.log(1e-3 / height) / (2 * math.log(restitution)))
    tail = 2 * fall * restitution**n / (1 - restitution)
    assert rest - tail / restitution - 0.02 < last < rest + 0.02
    assert np.abs(world.velocities).max() < 0.02


def test_under_simple_every_contact_of_a_flat_slide_keeps_the_tangential_factor():
    # With e = 0 a flat cube lies on the plane in every step: v = v0 f^n, and it comes to a stop
    # v0 dt f / (1 - f) from where it was. Each step rounds once: n half units.
    factor, n = 0.98, 900
    settings = Settings(model='simple', restitution=0.0, tangential_factor=factor)
    world = World(settings)
    world.throw((0, 0, 0.25), (0, 0, 0, 1), (3.0, -4.0, 0.0))
    world.step(n)
    assert world.contacts == n
    np.testing.assert_allclose(
        world.velocities[0, :2], factor**n * np.array([3.0, -4.0]), rtol=n * 2.0**-52
    )
    # A contact comes after the motion of its step: the first step goes at v0, then v0 f ...
    way = 0.002 * (1 - factor**n) / (1 - factor)
    np.testing.assert_allclose(
        world.poses[0, :2], way * np.array([3.0, -4.0]), rtol=0, atol=n * 2.0**-52
    )
    assert world.poses[0, 2] == 0.25


@pytest.mark.parametrize('model', MODELS)
def test_without_friction_a_tilted_plane_lets_a_flat_cube_slide_at_g_sin_theta(model):
    # v = g t sin(theta) along the slope and nothing else: contacts take the normal part alone.
    tilt = math.radians(25)
    azimuth = math.radians(40)
    down = np.array([math.cos(azimuth), math.sin(azimuth)])
    direction = (*(math.sin(tilt) * down), -math.cos(tilt))
    settings = Settings(
        model=model,
        restitution=0.0,
        friction=0.0,
        tangential_factor=1.0,
        gravity_direction=direction,
    )
    world = World(settings)
    world.throw((0, 0, 0.25), (0, 0, 0, 1))
    n = 400
    world.step(n)
    assert world.contacts == n
    np.testing.assert_allclose(
        world.velocities[0, :2], GRAVITY * math.sin(tilt) * n * 0.002 * down, rtol=n * 2.0**-52
    )
    assert world.velocities[0, 2:].tolist() == [0.0] * 4


def test_under_simple_a_slide_down_a_tilted_plane_reaches_its_terminal_speed():
    # v <- f (v + g_x dt) in every step: the fixed point is g_x dt f / (1 - f), reached as f^n.
    settings = Settings(
        model='simple', restitution=0.0, tangential_factor=0.9, gravity_direction=(0.6, 0.0, -0.8)
    )
    world = World(settings)
    world.throw((0, 0, 0.25), (0, 0, 0, 1))
    world.step(500)
    terminal = 0.6 * GRAVITY * 0.002 * 0.9 / (1 - 0.9)
    assert world.velocities[0, 0] == pytest.approx(terminal, rel=0.9**500 + 20 * 2.0**-52)
    assert world.velocities[0, 1] == 0.0


@pytest.mark.parametrize(
    ('friction', 'speed', 'fall'), [(0.3, 1.0, 2.0), (0.3, 40.0, 2.0), (5.0, 1.0, 2.0), (0, 9, 3)]
)
def test_under_impulse_a_flat_landing_rubs_by_the_clamped_friction_impulse(friction, speed, fall):
    # Flat, r = (0, 0, -c/2) at the impact: j_n = (1 + e) v_z, and with I = c^2/6 the denominator
    # of j_t is (c/2)^2 6/c^2 = 3/2, so j_t = -min(mu v_x / 1.5, j_n): the page's clamp is at j_n.
    # The torque of j_t turns the cube forward, about +y for a slide along +x.
    restitution, side = 0.4, 0.5
    settings = Settings(model='impulse', gravity=0.0, restitution=restitution, friction=friction)
    world = World(settings)
    depth = 0.001
    world.throw((0, 0, side / 2 - depth + 0.002 * fall), (0, 0, 0, 1), (speed, 0.0, -fall))
    world.step()
    j_n = (1 + restitution) * fall
    j_t = min(friction * speed / 1.5, j_n)
    expected = [speed - j_t, 0.0, restitution * fall, 0.0, 6 / side**2 * side / 2 * j_t, 0.0]
    # r_x is the mean of corners of equal depth: their sum rounds, nothing else is uncertain.
    np.testing.assert_allclose(world.velocities[0], expected, rtol=1e-13, atol=1e-13)


def one_corner_impacts(model: str, count: int, seed: int, **changes):
    """Impacts with one corner only: the settings, r, and the velocities before and after."""
    draw = Draw(seed)
    settings = Settings(model=model, gravity=0.0, **changes)
    found = []
    while len(found) < count:
        q = np.array(draw.orientation())
        v, w = np.array(draw.vector(-5.0, 5.0)), np.array(draw.vector(-9.0, 9.0))
        laws = reference.Laws(model, 0.002, 0.5, np.zeros(3), 0.0, 0.0, 0.0)
        p, q1, _, _ = reference.moved(laws, np.zeros(3), q, v, w)
        offsets = reference.corners(p, q1, 0.5) - p
        order = np.argsort(offsets[:, 2])
        r = offsets[order[0]]
        # Deep enough for one corner, not for the next.
        gap = offsets[order[1], 2] - r[2]
        if gap < 0.02 or (v + np.cross(w, r))[2] > -0.1:
            continue
        z = -r[2] - gap / 2 - 0.002 * v[2]
        world = World(settings)
        world.throw((0, 0, z), q, v, w)
        world.step()
        assert world.contacts == 1
        found.append((r, v, w, world.velocities[0, :3].copy(), world.velocities[0, 3:].copy()))
    return settings, found


@pytest.mark.parametrize('restitution', [0.0, 0.5, 1.0])
def test_an_impact_on_one_corner_reverses_the_approach_of_that_corner(restitution):
    # v+_r . n = -e v-_r . n, exactly that of the page's j_n while no friction impulse couples in.
    # And the energy falls by (1 - e^2) (v_r . n)^2 / (2 K), K = 1/m + |r x n|^2 / I: by nothing
    # at e = 1, and it never rises. Rounding: r is good to 1e-14 m, energies are below 100 J.
    _, impacts = one_corner_impacts('impulse', 300, 21, restitution=restitution, friction=0.0)
    inertia = 0.5**2 / 6
    for r, v, w, v_after, w_after in impacts:
        approach = (v + np.cross(w, r))[2]
        assert (v_after + np.cross(w_after, r))[2] == pytest.approx(
            -restitution * approach, abs=1e-11
        )
        lost = (v @ v - v_after @ v_after) / 2 + inertia * (w @ w - w_after @ w_after) / 2
        arm = np.cross(r, [0, 0, 1])
        yielding = 1 + arm @ arm / inertia
        assert lost == pytest.approx((1 - restitution**2) * approach**2 / (2 * yielding), abs=1e-10)


def test_an_impact_takes_its_friction_against_the_sliding_and_within_the_clamp():
    # J = j_n n + j_t t: v changes by J / m, w by r x J / I; j_t <= 0 and |j_t| <= j_n.
    settings, impacts = one_corner_impacts('impulse', 300, 22, restitution=0.5, friction=0.6)
    assert settings.friction == 0.6
    inertia = 0.5**2 / 6
    for r, v, w, v_after, w_after in impacts:
        impulse = v_after - v
        sliding = v + np.cross(w, r)
        sliding[2] = 0.0
        along = impulse[:2] @ sliding[:2] / np.linalg.norm(sliding)
        across = impulse[0] * sliding[1] - impulse[1] * sliding[0]
        assert abs(across) <= 1e-11
        assert -impulse[2] - 1e-12 <= along < 0.0
        np.testing.assert_allclose(
            inertia * (w_after - w), np.cross(r, impulse), rtol=0, atol=1e-11
        )


def test_under_simple_an_impact_leaves_the_spin_alone_and_reflects_the_centre():
    # v <- (f v_x, f v_y, -e v_z), one rounding each; w keeps every bit.
    settings, impacts = one_corner_impacts('simple', 200, 23, restitution=0.3)
    reflected = 0
    for _, v, w, v_after, w_after in impacts:
        sinks = v[2] < 0
        expected = [0.9 * v[0], 0.9 * v[1], -(0.3 * v[2])] if sinks else v.tolist()
        assert v_after.tolist() == expected
        assert w_after.tolist() == w.tolist()
        reflected += bool(sinks)
    assert settings.tangential_factor == 0.9
    assert 0 < reflected < len(impacts)


@pytest.mark.parametrize('model', MODELS)
def test_after_a_step_no_corner_is_below_the_plane(model):
    # Pushed out by the depth of the deepest corner: to rounding of coordinates of about a metre.
    draw = Draw(24)
    world = World(Settings(model=model, gravity_direction=(0.3, 0.1, -0.9)))
    for _ in range(30):
        world.throw(
            [0, 0, draw.number(-0.5, 1.0)],
            draw.orientation(),
            draw.vector(-4.0, 4.0),
            draw.vector(-9.0, 9.0),
        )
    for _ in range(40):
        world.step(10)
        for pose in world.poses:
            assert reference.corners(pose[:3], pose[3:], 0.5)[:, 2].min() >= -1e-15
    assert world.contacts > 500


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('side', [0.001, 64.0])
def test_the_side_of_the_cubes_scales_the_contact(model, side):
    # Lengths, speeds and gravity times c with the same times: the same motion, times c; to the
    # 1e-12 that chaos makes of rounding in the few impacts of half a second.
    def run(c: float) -> World:
        world = World(Settings(model=model, cube_size=c, gravity=9.81 * c, friction=0.3))
        q = (0.1, 0.2, 0.3, 0.9)
        world.throw((0, 0, 2 * c), q, (c, 2 * c, -3 * c), (1, 2, 3))
        world.step(250)
        return world

    one, scaled = run(1.0), run(side)
    assert one.contacts == scaled.contacts > 0
    np.testing.assert_allclose(scaled.poses[0, :3] / side, one.poses[0, :3], rtol=0, atol=1e-10)
    np.testing.assert_allclose(scaled.poses[0, 3:], one.poses[0, 3:], rtol=0, atol=1e-10)
    np.testing.assert_allclose(scaled.velocities[0, 3:], one.velocities[0, 3:], rtol=0, atol=1e-9)
