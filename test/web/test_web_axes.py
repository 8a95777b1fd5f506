"""The page's conventions, and where it is served."""

from __future__ import annotations

import numpy as np
import pytest

from cube_sim.physics.world import turned_by
from cube_sim.simulation.ground import ground_triangles
from cube_sim.web import address
from cube_sim.web.axes import body_pose, look_at, page_wxyz, same_pose

ROOT_HALF = np.sqrt(0.5)


def test_a_page_that_looks_along_world_x_is_a_body_without_a_turn():
    """OpenCV's z (ahead) along world x, its x (right) along −y, its y (down) along −z."""
    pose = body_pose((1.0, 2.0, 3.0), (0.5, -0.5, 0.5, -0.5))
    assert pose == pytest.approx([1, 2, 3, 0, 0, 0, 1])


def test_both_ways_and_back_again_change_nothing():
    rng = np.random.default_rng(0)
    for wxyz in rng.normal(size=(20, 4)):
        wxyz /= np.linalg.norm(wxyz)
        pose = body_pose((1.0, 2.0, 3.0), wxyz)
        assert abs(page_wxyz(pose) @ wxyz) == pytest.approx(1.0)
        w, x, y, z = wxyz
        right, down, ahead = (turned_by((x, y, z, w), axis) for axis in np.eye(3))
        for axis, way in zip(np.eye(3), (ahead, -right, -down), strict=True):
            assert turned_by(pose[3:], axis) == pytest.approx(way)
        assert look_at(pose, 2.0) == pytest.approx(np.array([1, 2, 3]) + 2 * ahead)


def test_a_quaternion_and_its_negative_are_the_same_pose():
    pose = np.array([0, 0, 1.5, 0, 0, ROOT_HALF, ROOT_HALF])
    assert same_pose(pose, pose * [1, 1, 1, -1, -1, -1, -1])
    assert not same_pose(pose, pose + 0.001 * np.eye(7)[0])


def test_the_ground_of_the_marker_is_the_ground_of_the_simulation():
    from cube_sim.messages.markers import triangle_list
    from cube_sim.web.stage import ground_of

    points, colors = ground_triangles()
    found, shades = ground_of(triangle_list(0, 'world', 'ground', points, colors))
    assert np.array_equal(found, points)
    assert shades == pytest.approx(colors, abs=1e-6)


def test_an_address_that_cannot_be_is_refused_before_anything_starts():
    address.check('127.0.0.1', 0)
    with pytest.raises(address.AddressError, match='no such address'):
        address.check('203.0.113.7', 8080)
    with pytest.raises(address.AddressError, match='0 to 65535'):
        address.check('127.0.0.1', 70000)


def test_serving_beyond_this_machine_says_what_it_means():
    assert address.warning('127.0.0.1') == address.warning('localhost') == ''
    assert 'without a password' in address.warning('0.0.0.0')
    assert address.url('0.0.0.0', 8080) == 'http://127.0.0.1:8080'
    assert address.url('::1', 80) == 'http://[::1]:80'
