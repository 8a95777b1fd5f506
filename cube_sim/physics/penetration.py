"""How deep cubes are in the plane and in each other, measured from their poses alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cube_sim.physics.world import POSITION_LIMIT, unit_quaternions, vectors

Floats = NDArray[np.float64]

# Directions shorter than this are those of two parallel edges: the faces have tested them.
NO_DIRECTION = 1e-3


def plane_penetration(poses: ArrayLike, cube_size: float) -> Floats:
    """
    Return how deep the lowest corner of each cube is below z = 0, m, (N,); negative above.

    `poses` is (N, 7), x y z qx qy qz qw, m, world, as `World.poses`; `cube_size` the side, m.
    PhysicsError where they are no poses.
    """
    positions, axes = _frames(poses)
    depths: Floats = 0.5 * cube_size * np.abs(axes[:, 2, :]).sum(axis=1) - positions[:, 2]
    return depths


def cube_penetration(poses: ArrayLike, cube_size: float) -> tuple[Floats, NDArray[np.int64]]:
    """
    Return how deep cubes are in each other, m, (K,), and which, (K, 2): all pairs that overlap.

    The depth is the least distance by which one of the two would have to go to part them: of
    15 axes (6 faces, 9 pairs of edges) the one with the least overlap (Gottschalk et al. 1996).
    `poses` and errors as for `plane_penetration`.
    """
    positions, axes = _frames(poses)
    first, second = _near(positions, np.sqrt(3.0) * cube_size)
    way = positions[second] - positions[first]
    a, b = axes[first], axes[second]
    edges = np.cross(a.transpose(0, 2, 1)[:, :, None, :], b.transpose(0, 2, 1)[:, None, :, :])
    directions = np.concatenate(
        [a.transpose(0, 2, 1), b.transpose(0, 2, 1), edges.reshape(-1, 9, 3)], axis=1
    )
    lengths = np.linalg.norm(directions, axis=2)
    counted = lengths > NO_DIRECTION
    directions = directions / np.where(counted, lengths, 1.0)[:, :, None]
    reach = 0.5 * cube_size * (np.abs(directions @ a).sum(axis=2) + np.abs(directions @ b).sum(2))
    overlap = reach - np.abs(np.einsum('kdi,ki->kd', directions, way))
    depth = np.where(counted, overlap, np.inf).min(axis=1, initial=np.inf)
    deep = depth > 0.0
    return depth[deep], np.stack([first, second], axis=1)[deep]


def _frames(poses: ArrayLike) -> tuple[Floats, Floats]:
    """Return the positions (N, 3) and the rotation matrices (N, 3, 3) of poses."""
    rows = vectors('poses', poses, 7, POSITION_LIMIT, 'm')
    x, y, z, w = unit_quaternions(rows[:, 3:]).T
    matrices = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    return rows[:, :3], np.moveaxis(matrices, 2, 0)


def _near(positions: Floats, distance: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs (first < second) of points within `distance` of each other, m."""
    order = np.argsort(positions[:, 0], kind='stable')
    along = positions[order, 0]
    ends = np.searchsorted(along, along + distance, side='right')
    counts = ends - np.arange(len(order)) - 1
    left = np.repeat(np.arange(len(order)), counts)
    starts = np.cumsum(counts) - counts
    right = np.arange(counts.sum()) - np.repeat(starts, counts) + left + 1
    one, other = order[left], order[right]
    gaps = positions[one] - positions[other]
    close = np.einsum('ki,ki->k', gaps, gaps) <= distance * distance
    one, other = one[close], other[close]
    return np.minimum(one, other).astype(np.int64), np.maximum(one, other).astype(np.int64)
