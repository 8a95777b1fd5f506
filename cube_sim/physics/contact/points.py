"""The contact points of the last step, gathered from the memory of the model."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.contact import layout
from cube_sim.physics.engine import NO_CONTACT_POINTS, ContactPoints

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def contact_points(
    state: Floats,
    cubes: Floats,
    blocks: Floats,
    lanes: Integers,
    block_count: int,
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
    used, owners = blocks[:block_count], lanes[:block_count]
    lane = np.arange(layout.LANES)
    for p in range(layout.MOST_POINTS):
        columns = used[:, layout.POINT + p * layout.POINT_SIZE :]
        there = (lane < owners[:, layout.LENGTH, None]) & (p < owners[:, layout.COUNT, None])
        there &= _column(owners, layout.CUBE_A) != ground
        push = _vectors(columns, layout.TOTAL)
        block, i = np.nonzero(there & np.any(push != 0.0, axis=2))
        a, b = owners[block, layout.CUBE_A + i], owners[block, layout.CUBE_B + i]
        place = cubes[a, layout.POSE : layout.POSE + 3]
        positions.append(_vectors(columns, layout.ARM)[block, i] + place)
        # The first cube of a pair is pushed against the normal, which points at the second.
        normals.append(-_vectors(used, layout.N)[block, i])
        impulses.append(-push[block, i])
        indices.append(np.stack([a, b], axis=1))
    return ContactPoints(
        np.concatenate(positions),
        np.concatenate(normals),
        np.concatenate(impulses),
        np.concatenate(indices).astype(np.int64),
    )


def sleeping_points(
    state: Floats, pairs: Floats, near: Integers, counts: Integers, share: float
) -> ContactPoints:
    """
    Return the points between cubes that sleep, with the impulses that they fell asleep with.

    `near` (M, 3) are the pairs (row of `pairs`, both cubes) of which both sleep, `counts` (M,)
    their numbers of points. A step has `share` times the impulses of a sub-step.
    """
    found = [NO_CONTACT_POINTS]
    for p in range(layout.MOST_POINTS):
        columns = pairs[near[:, 0], layout.PAIR_POINT + p * layout.PAIR_POINT_COLUMNS :]
        there = (p < counts) & (columns[:, layout.KEPT_N] > 0.0)
        columns, chosen = columns[there], near[there]
        turns = state[3:7, chosen[:, 1]].T
        row = pairs[chosen[:, 0]]
        normals = turned(turns, row[:, layout.LOCAL_NORMAL : layout.LOCAL_NORMAL + 3])
        push = columns[:, layout.KEPT_N, None] * normals
        push = push + columns[:, layout.KEPT_T : layout.KEPT_T + 3]
        local = columns[:, layout.LOCAL_A : layout.LOCAL_A + 3]
        positions = state[:3, chosen[:, 1]].T + turned(turns, local)
        found.append(ContactPoints(positions, -normals, -share * push, chosen[:, 1:]))
    return joined(found)


def joined(parts: list[ContactPoints]) -> ContactPoints:
    """Return the points of all parts."""
    return ContactPoints(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def turned(orientations: Floats, vectors: Floats) -> Floats:
    """Return vectors (K, 3) turned by unit quaternions (K, 4), x y z w."""
    axes, w = orientations[:, :3], orientations[:, 3:]
    return vectors + 2.0 * np.cross(axes, np.cross(axes, vectors) + w * vectors)


def _column(rows: NDArray[Any], column: int) -> NDArray[Any]:
    """Return a column of all blocks, (B, LANES)."""
    return rows[:, column : column + layout.LANES]


def _vectors(rows: Floats, column: int) -> Floats:
    """Return three columns of all blocks as vectors, (B, LANES, 3)."""
    size = layout.LANES
    return np.stack([_column(rows, column + n * size) for n in range(3)], axis=2)
