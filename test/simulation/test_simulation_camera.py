"""The camera: where it may be, and how it flies."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cube_sim.physics import PhysicsError
from cube_sim.simulation.camera import Camera

ROOT = 0.5**0.5


def test_a_camera_begins_at_eye_level_and_looks_along_x():
    assert Camera().pose.tolist() == [0, 0, 1.5, 0, 0, 0, 1]


def test_an_orientation_is_normalised_and_one_of_unit_length_keeps_its_bits():
    camera = Camera((1, 2, 3), (0, 0, 3, 4))
    np.testing.assert_allclose(camera.orientation, [0, 0, 0.6, 0.8], rtol=2e-16)
    before = camera.pose
    camera.place(camera.position, camera.orientation)
    assert camera.pose.tobytes() == before.tobytes()


@pytest.mark.parametrize(
    ('position', 'orientation'),
    [
        ((1, 2), (0, 0, 0, 1)),
        ((1, 2, 3), (0, 0, 1)),
        ((1, 2, math.nan), (0, 0, 0, 1)),
        ((1, 2, 2e7), (0, 0, 0, 1)),
        ((1, 2, 3), (0, 0, 0, 0)),
        ((1, 2, 3), (0, 0, math.inf, 1)),
        ('abc', (0, 0, 0, 1)),
    ],
)
def test_a_place_that_is_none_is_refused_and_the_pose_stays(position, orientation):
    camera = Camera((4, 5, 6), (0, 0, 1, 0))
    with pytest.raises(PhysicsError, match='camera'):
        camera.place(position, orientation)
    assert camera.pose.tolist() == [4, 5, 6, 0, 0, 1, 0]
    with pytest.raises(PhysicsError, match='camera'):
        Camera(position, orientation)


def test_what_is_read_of_a_camera_does_not_move_it():
    camera = Camera()
    for read in (camera.pose, camera.position, camera.orientation):
        read[:] = 9.0
    assert camera.pose.tolist() == [0, 0, 1.5, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ('linear', 'world'),
    [
        ((2, 0, 0), (0, 3, 0)),
        ((0, 2, 0), (-3, 0, 0)),
        ((0, 0, 2), (0, 0, 3)),
        ((1, 2, 3), (-3, 1.5, 4.5)),
    ],
)
def test_a_camera_flies_in_its_own_axes(linear, world):
    # Turned by a quarter about z its x axis, forward, is the world's y, and its y, left, is -x.
    camera = Camera((1, 1, 1), (0, 0, ROOT, ROOT))
    camera.fly(linear, (0, 0, 0), 1.5)
    np.testing.assert_allclose(camera.position, np.add((1, 1, 1), world), atol=4e-15)
    np.testing.assert_allclose(camera.orientation, (0, 0, ROOT, ROOT), atol=2e-16)


@pytest.mark.parametrize(
    ('angular', 'forward'),
    [((0, 0, 1), (0, 1, 0)), ((0, 1, 0), (0, 0, -1)), ((1, 0, 0), (1, 0, 0))],
)
def test_a_camera_turns_by_the_right_hand(angular, forward):
    # A quarter turn: about z (up) to the left, about y (left) downwards, about x it only rolls.
    camera = Camera()
    camera.fly((0, 0, 0), angular, math.pi / 2)
    camera.fly((1, 0, 0), (0, 0, 0), 1.0)
    np.testing.assert_allclose(camera.position - (0, 0, 1.5), forward, atol=1e-15)


def test_a_turn_is_about_the_axes_that_the_camera_has_by_then():
    # Yaw by a quarter, then pitch by a quarter about its new left, -x: it looks straight down.
    # About the old left, y, where it looks already, it would only have rolled.
    camera = Camera((0, 0, 0))
    camera.fly((0, 0, 0), (0, 0, math.pi / 2), 1.0)
    camera.fly((0, 0, 0), (0, math.pi / 2, 0), 1.0)
    camera.fly((1, 0, 0), (0, 0, 0), 1.0)
    np.testing.assert_allclose(camera.position, (0, 0, -1), atol=1e-15)


@pytest.mark.parametrize('frames', [12, 1000])
def test_a_turning_flight_is_a_circle_of_radius_v_over_w(frames):
    # Each frame goes straight along where the camera looks, then turns: a regular polygon of sides
    # v T / n, whose circumradius v T / (2 n sin(pi / n)) is v / w to second order in 1 / n. After a
    # whole turn it is back; each frame rounds a few times.
    speed, turn = 3.0, 0.8
    period = 2 * math.pi / turn
    camera = Camera((0, 0, 0))
    radius = speed * period / (2 * frames * math.sin(math.pi / frames))
    assert radius == pytest.approx(speed / turn, rel=2 * (math.pi / frames) ** 2)
    # The centre is to the left of the middle of the first side.
    side = speed * period / frames
    centre = np.array([side / 2, math.sqrt(radius**2 - side**2 / 4), 0.0])
    tolerance = frames * 4e-15
    for _ in range(frames):
        camera.fly((speed, 0, 0), (0, 0, turn), period / frames)
        assert np.linalg.norm(camera.position - centre) == pytest.approx(radius, abs=tolerance)
    np.testing.assert_allclose(camera.position, (0, 0, 0), atol=tolerance)
    # A whole turn of the quaternion's double cover.
    np.testing.assert_allclose(camera.orientation, (0, 0, 0, -1), atol=tolerance)


def test_a_long_flight_keeps_the_orientation_at_unit_length():
    camera = Camera((0, 0, 0), (0.1, 0.2, 0.3, 0.4))
    for _ in range(5000):
        camera.fly((0, 0, 0), (0.3, -0.2, 0.9), 0.02)
    # As `place` accepts it unchanged: |q|^2 - 1 within 4e-15.
    assert abs(np.sum(camera.orientation**2) - 1.0) <= 4e-15


@pytest.mark.parametrize('linear', [(math.nan, 0, 0), (1e9, 0, 0)])
def test_a_flight_to_nowhere_is_refused_and_the_pose_stays(linear):
    camera = Camera()
    with pytest.raises(PhysicsError):
        camera.fly(linear, (0, 0, 1), 1.0)
    assert camera.pose.tolist() == [0, 0, 1.5, 0, 0, 0, 1]
