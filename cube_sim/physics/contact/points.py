"""The contact points of the last step, gathered from the memory of the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.contact import layout
from cube_sim.physics.engine import ContactPoints

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def contact_points(
    state: Floats,
    cubes: Floats,
    pairs: Floats,
    ends: Integers,
    counters: Integers,
    ground: int,
    half_side: float,
) -> ContactPoints:
    """
    Return every point that took an impulse in the last step.

    Those on the plane lie where the corners are now, those between two cubes where they were when
    the step looked for them.
    """
    count = state.shape[1]
    pushes = cubes[:count, layout.PUSH : layout.PUSH + 24].reshape(count, 8, 3)
    which, corner = np.nonzero(pushes[:, :, 2] > 0.0)
    signs = np.where(corner[:, None] & np.array([1, 2, 4]), 1.0, -1.0) * half_side
    positions = [state[:3, which].T + turned(state[3:7, which].T, signs)]
    normals = [np.tile([0.0, 0.0, 1.0], (len(which), 1))]
    impulses = [pushes[which, corner]]
    indices = [np.stack([which, np.full(len(which), -1)], axis=1)]
    for n in range(counters[layout.ACTIVES]):
        row, a, b = ends[n, layout.ACTIVE : layout.ACTIVE + 3]
        if a == ground:
            continue
        size = layout.POINT_COLUMNS
        points = pairs[row, layout.POINT :].reshape(4, size)[: ends[row, layout.POINTS]]
        points = points[np.any(points[:, layout.TOTAL : layout.TOTAL + 3] != 0.0, axis=1)]
        place = cubes[a, layout.PLACE : layout.PLACE + 3]
        positions.append(points[:, layout.ARM_A : layout.ARM_A + 3] + place)
        # The first cube of a pair is pushed against the normal, which points at the second.
        normal = -pairs[row, layout.NORMAL : layout.NORMAL + 3]
        normals.append(np.tile(normal, (len(points), 1)))
        impulses.append(-points[:, layout.TOTAL : layout.TOTAL + 3])
        indices.append(np.tile([a, b], (len(points), 1)))
    return ContactPoints(
        np.concatenate(positions),
        np.concatenate(normals),
        np.concatenate(impulses),
        np.concatenate(indices).astype(np.int64),
    )


def turned(orientations: Floats, vectors: Floats) -> Floats:
    """Return vectors (K, 3) turned by unit quaternions (K, 4), x y z w."""
    axes, w = orientations[:, :3], orientations[:, 3:]
    return vectors + 2.0 * np.cross(axes, np.cross(axes, vectors) + w * vectors)
