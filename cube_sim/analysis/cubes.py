"""What is known of each cube of a run: one record, however it was found out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Records = NDArray[np.void]

# A cube counts as at rest when neither its centre nor its rim moves faster than this until the
# recording or the cube ends, m/s ...
REST_SPEED = 0.05
# ... and that for at least this long, ns.
REST_NS = 500_000_000

# One cube. `generation` is the number of resets before it; times ns; pose (7,) and velocity (6,)
# as in cube_sim.physics, m, m/s, rad/s, world; energies J, split into potential, translation,
# rotation. `flight`, `lift`, `bounced`, `touched`, `changed` are the energies that it gained by
# the integrator, by being pushed out of the plane, at bounces, at touches too slow to be one, and
# by changes of settings; `unclear` is what was gained where poses alone cannot tell.
CUBE = np.dtype(
    [
        ('generation', np.int32),
        ('cube', np.int32),
        ('thrown_ns', np.int64),
        ('ended_ns', np.int64),
        ('removed', np.bool_),
        ('pose', np.float64, 7),
        ('velocity', np.float64, 6),
        ('thrown_energy', np.float64, 3),
        ('end_pose', np.float64, 7),
        ('end_velocity', np.float64, 6),
        ('end_energy', np.float64, 3),
        ('flight', np.float64),
        ('lift', np.float64),
        ('bounced', np.float64),
        ('touched', np.float64),
        ('changed', np.float64),
        ('unclear', np.float64),
        ('bounces', np.int64),
        ('touches', np.int64),
        ('unclear_stretches', np.int64),
        ('deepest', np.float64),
        ('deepest_ns', np.int64),
        ('last_fast_ns', np.int64),
        ('apex', np.float64),
        ('apex_ns', np.int64),
    ]
)


class Table:
    """Records of one type that grow at the end: memory for what there is, doubled as needed."""

    def __init__(self, dtype: np.dtype[np.void]) -> None:
        """Begin empty."""
        self._memory: Records = np.zeros(16, dtype)
        self._count = 0

    def __len__(self) -> int:
        """Return the number of records."""
        return self._count

    @property
    def records(self) -> Records:
        """The records (N,): a view that holds until the next `append`."""
        return self._memory[: self._count]

    def append(self, records: Records) -> int:
        """Add `records` (K,) and return the index of the first."""
        first = self._count
        if first + len(records) > len(self._memory):
            size = max(first + len(records), 2 * len(self._memory))
            memory: Records = np.zeros(size, self._memory.dtype)
            memory[:first] = self._memory[:first]
            self._memory = memory
        self._memory[first : first + len(records)] = records
        self._count += len(records)
        return first


def new_cubes(generation: int, first: int, time_ns: int, poses: Floats) -> Records:
    """Return the records of cubes `first` ... that are first seen at `time_ns`, poses (K, 7)."""
    records: Records = np.zeros(len(poses), CUBE)
    records['generation'] = generation
    records['cube'] = first + np.arange(len(poses))
    records['thrown_ns'] = time_ns
    records['ended_ns'] = time_ns
    records['pose'] = poses
    records['velocity'] = np.nan
    records['end_pose'] = poses
    records['end_velocity'] = np.nan
    records['last_fast_ns'] = time_ns
    records['apex'] = np.nan
    return records


def rest_ns(cube: Any) -> int | None:
    """Return when the cube of this record came to rest, ns, or None if it did not."""
    still = int(cube['ended_ns']) - int(cube['last_fast_ns'])
    return int(cube['last_fast_ns']) if still >= REST_NS else None


def is_fast(velocities: Floats, cube_size: float) -> NDArray[np.bool_]:
    """Return which of the cubes with velocities (N, 6) move faster than `REST_SPEED`."""
    # The corners are the rim: half a space diagonal from the centre.
    rim = 0.75 * cube_size * cube_size
    squares = (velocities * velocities) @ _SUMS
    fast: NDArray[np.bool_] = (squares * np.array([1.0, rim]) > REST_SPEED**2).any(axis=1)
    return fast


# Sums up the squares of v and of w.
_SUMS = np.array([[1.0, 0.0]] * 3 + [[0.0, 1.0]] * 3)
