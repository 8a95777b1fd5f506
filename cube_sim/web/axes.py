"""Two conventions of cameras: ROS's body (x forward, y left, z up) and the page's."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cube_sim.physics.world import turned_by

Floats = NDArray[np.float64]

# The page's cameras look along z, with x to the right and y down (OpenCV), and their quaternions
# start with w. This is the body in the axes of such a camera.
_BODY_IN_PAGE = (0.5, 0.5, -0.5, 0.5)
_PAGE_IN_BODY = (0.5, -0.5, 0.5, -0.5)


def body_pose(position: ArrayLike, wxyz: ArrayLike) -> Floats:
    """Return the page's camera as x y z qx qy qz qw of a body, m, world."""
    w, x, y, z = _product(np.asarray(wxyz, np.float64), np.array(_BODY_IN_PAGE))
    return np.array([*np.asarray(position, np.float64), x, y, z, w])


def page_wxyz(pose: Floats) -> Floats:
    """Return how a camera of the page is turned, w x y z, that looks as the body at `pose`."""
    x, y, z, w = pose[3:]
    return _product(np.array([w, x, y, z]), np.array(_PAGE_IN_BODY))


def look_at(pose: Floats, distance: float) -> Floats:
    """Return the point (3,) at `distance`, m, straight ahead of a body."""
    ahead: Floats = pose[:3] + turned_by(pose[3:], (distance, 0.0, 0.0))
    return ahead


def same_pose(one: Floats, other: Floats) -> bool:
    """Say whether two poses are the same but for rounding; q and -q are one orientation."""
    near = np.allclose(one[:3], other[:3], rtol=1e-9, atol=1e-9)
    return bool(near and abs(float(one[3:] @ other[3:])) > 1.0 - 1e-9)


def _product(one: Floats, other: Floats) -> Floats:
    """Return the product of two quaternions w x y z."""
    aw, ax, ay, az = one
    bw, bx, by, bz = other
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )
