"""How deep cubes are in each other, against cases whose depth is plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cube_sim.physics import PhysicsError
from cube_sim.physics.penetration import cube_penetration, plane_penetration

FLAT = (0.0, 0.0, 0.0, 1.0)
# An eighth of a turn about z, and what brings the diagonal of a cube upright.
EIGHTH = (0.0, 0.0, math.sin(math.pi / 8), math.cos(math.pi / 8))
HALF_TILT = 0.5 * math.acos(1.0 / math.sqrt(3.0))
ON_CORNER = (
    math.sin(HALF_TILT) / math.sqrt(2.0),
    -math.sin(HALF_TILT) / math.sqrt(2.0),
    0.0,
    math.cos(HALF_TILT),
)


def test_the_depth_in_the_plane_is_that_of_the_lowest_corner():
    poses = [(0.0, 0.0, 0.2, *FLAT), (0.0, 0.0, 0.3, *EIGHTH), (9.0, 0.0, 0.4, *ON_CORNER)]
    expected = [0.05, -0.05, 0.25 * math.sqrt(3.0) - 0.4]
    np.testing.assert_allclose(plane_penetration(poses, 0.5), expected, atol=1e-12)


@pytest.mark.parametrize(
    ('way', 'turn', 'depth'),
    [
        ((0.4, 0.1, 0.0), FLAT, 0.1),
        ((0.1, -0.2, 0.45), FLAT, 0.05),
        ((0.6, 0.0, 0.0), EIGHTH, 0.25 + 0.25 * math.sqrt(2.0) - 0.6),
        ((0.0, 0.0, 0.65), ON_CORNER, 0.25 + 0.25 * math.sqrt(3.0) - 0.65),
    ],
)
def test_the_depth_of_two_cubes_is_the_least_way_that_parts_them(way, turn, depth):
    poses = np.array([(0.0, 0.0, 1.0, *FLAT), (*np.add(way, (0.0, 0.0, 1.0)), *turn)])
    for order in ([0, 1], [1, 0]):
        depths, pairs = cube_penetration(poses[order], 0.5)
        np.testing.assert_allclose(depths, [depth], atol=1e-12)
        assert pairs.tolist() == [[0, 1]]


def test_two_crossed_edges_are_parted_across_both():
    # Edge upon edge: one cube on an edge along x, the other, upside down, on one along y.
    half = math.sin(math.pi / 8), math.cos(math.pi / 8)
    poses = [(0.0, 0.0, 0.0, half[0], 0.0, 0.0, half[1]), (0.0, 0.0, 0.7, 0.0, *half)]
    poses[1] = (0.0, 0.0, 0.7, 0.0, half[0], 0.0, half[1])
    depths, _ = cube_penetration(poses, 0.5)
    np.testing.assert_allclose(depths, [0.5 * math.sqrt(2.0) - 0.7], atol=1e-12)


def test_cubes_that_are_apart_are_not_listed():
    grid = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), axis=-1).reshape(-1, 3) * 0.51
    poses = np.concatenate([grid, np.tile(FLAT, (len(grid), 1))], axis=1)
    assert len(cube_penetration(poses, 0.5)[0]) == 0
    depths, pairs = cube_penetration(poses, 0.52)
    # Each with all that are one step off along any axes: those of the grid of side 6 within 26.
    assert len(pairs) == ((6 + 2 * 5) ** 3 - 6**3) // 2
    np.testing.assert_allclose(depths, 0.01, atol=1e-12)
    assert len(cube_penetration(poses[:1], 0.5)[1]) == 0


@pytest.mark.parametrize('poses', [[(0.0, 0.0, 1.0)], [(0.0, 0.0, math.nan, *FLAT)]])
def test_what_is_no_pose_is_refused(poses):
    with pytest.raises(PhysicsError, match='poses'):
        cube_penetration(poses, 0.5)
