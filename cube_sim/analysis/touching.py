"""Where cubes touch the plane z = 0: the detection of the physics for many cubes at once."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def rotations(orientations: Floats) -> Floats:
    """Return the matrices (N, 3, 3) of unit quaternions (N, 4), x y z w."""
    x, y, z, w = orientations.T
    matrices = np.empty((len(orientations), 3, 3))
    matrices[:, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrices[:, 0, 1] = 2.0 * (x * y - z * w)
    matrices[:, 0, 2] = 2.0 * (x * z + y * w)
    matrices[:, 1, 0] = 2.0 * (x * y + z * w)
    matrices[:, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrices[:, 1, 2] = 2.0 * (y * z - x * w)
    matrices[:, 2, 0] = 2.0 * (x * z - y * w)
    matrices[:, 2, 1] = 2.0 * (y * z + x * w)
    matrices[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return matrices


def lowest_corners(poses: Floats, cube_size: float) -> Floats:
    """Return the heights (N,) of the lowest corners of cubes of side `cube_size`, m."""
    x, y, z, w = poses[:, 3:].T
    reach = np.abs(x * z - y * w) + np.abs(y * z + x * w)
    reach = 2.0 * reach + np.abs(1.0 - 2.0 * (x * x + y * y))
    lowest: Floats = poses[:, 2] - 0.5 * cube_size * reach
    return lowest


def contact_arms(poses: Floats, cube_size: float, slack: float = 0.0) -> Floats:
    """
    Return r = P_c - p (N, 3), m, world: from the centre to the contact point.

    P_c is the depth-weighted mean of the penetrating corners, as in
    `cube_sim.physics.detection`. Where none penetrates, or with a `slack` (m), depths are
    measured from that far above the lowest corner.
    """
    offsets = (0.5 * cube_size * _CORNERS) @ rotations(poses[:, 3:]).transpose(0, 2, 1)
    heights = poses[:, 2, None] + offsets[:, :, 2]
    lowest = heights.min(axis=1)
    if slack > 0.0:
        level = lowest + slack
    else:
        level = np.where(lowest < 0.0, 0.0, lowest + 1e-9 * cube_size)
    depths = np.maximum(level[:, None] - heights, 0.0)
    arms: Floats = (depths[:, None, :] @ offsets)[:, 0, :] / depths.sum(axis=1)[:, None]
    return arms
