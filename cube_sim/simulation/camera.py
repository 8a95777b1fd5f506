"""The camera of the report: where cubes come from."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cube_sim.physics.world import POSITION_LIMIT, turned_by, unit_quaternions, vectors

Floats = NDArray[np.float64]


class Camera:
    """A pose in world with the body convention: x forward, y left, z up (REP-103)."""

    def __init__(
        self,
        position: ArrayLike = (0.0, 0.0, 1.5),
        orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    ) -> None:
        """Place the camera; PhysicsError as in `place`."""
        self._pose: Floats = np.empty(7)
        self.place(position, orientation)

    @property
    def position(self) -> Floats:
        """Where it is, (3,), m, world."""
        return np.array(self._pose[:3])

    @property
    def orientation(self) -> Floats:
        """How it is turned, (4,), a unit quaternion x y z w."""
        return np.array(self._pose[3:])

    @property
    def pose(self) -> Floats:
        """Position and orientation, (7,), as `geometry_msgs/Pose` lays them out."""
        return np.array(self._pose)

    def place(self, position: ArrayLike, orientation: ArrayLike) -> None:
        """
        Put the camera at `position` (3,), m, turned by `orientation` (4,), x y z w.

        PhysicsError, and no change, when a number is not finite or the quaternion is zero; one
        that merely is not of unit length is normalised.
        """
        place = vectors('camera position', position, 3, POSITION_LIMIT, 'm')
        turn = unit_quaternions(orientation, 'camera orientation')
        self._pose[:] = np.concatenate([place[0], turn[0]])

    def fly(self, linear: ArrayLike, angular: ArrayLike, seconds: float) -> None:
        """Move for `seconds` at `linear` (3,) m/s and `angular` (3,) rad/s, in its own axes."""
        x, y, z = np.asarray(angular, np.float64) * (0.5 * seconds)
        angle = math.sqrt(x * x + y * y + z * z)
        sinc = math.sin(angle) / angle if angle > 1e-12 else 1.0
        bx, by, bz, bw = x * sinc, y * sinc, z * sinc, math.cos(angle)
        ax, ay, az, aw = self._pose[3:]
        turn = [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
        way = turned_by(self._pose[3:], np.asarray(linear, np.float64) * seconds)
        self.place(self._pose[:3] + way, turn)
