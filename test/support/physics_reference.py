"""
The laws of motion and contact a second time, as plainly as they can be written.

Matrices, generic cross products and libm: nothing here is shared with the product, so that an
error would have to be made twice. One cube, 1 kg; p m, q x y z w, v m/s, w rad/s, frame world,
z up; the plane is z = 0 with the normal n = (0, 0, 1).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

NORMAL = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Laws:
    """What a step depends on: seconds, metres, m/s^2, and the coefficients of the models."""

    model: str
    time_step: float
    side: float
    gravity: np.ndarray
    restitution: float
    friction: float
    tangential_factor: float


def matrix(q: np.ndarray) -> np.ndarray:
    """R(q) = 1 + 2 w [u]x + 2 [u]x [u]x for the unit quaternion (u, w)."""
    skew = np.array([[0.0, -q[2], q[1]], [q[2], 0.0, -q[0]], [-q[1], q[0], 0.0]])
    return np.eye(3) + 2.0 * q[3] * skew + 2.0 * skew @ skew


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton's product of two quaternions x y z w: first turn by b, then by a."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])


def exponential(half_turn: np.ndarray) -> np.ndarray:
    """exp of the pure quaternion `half_turn`, that is (sin|h| h/|h|, cos|h|)."""
    angle = math.sqrt(half_turn @ half_turn)
    if angle == 0.0:
        return np.array([0.0, 0.0, 0.0, 1.0])
    return np.array([*(math.sin(angle) * half_turn / angle), math.cos(angle)])


def corners(p: np.ndarray, q: np.ndarray, side: float) -> np.ndarray:
    """The eight corners x_k = p + R(q) (+-c/2, +-c/2, +-c/2)."""
    half = 0.5 * side
    local = np.array(list(itertools.product((-half, half), repeat=3)))
    return p + local @ matrix(q).T


def moved(laws: Laws, p, q, v, w):
    """Phase 1, motion: semi-implicit Euler, and q <- exp(w dt / 2) q."""
    v = v + laws.gravity * laws.time_step
    p = p + v * laws.time_step
    q = product(exponential(0.5 * laws.time_step * w), q)
    return p, q / math.sqrt(q @ q), v, w


def contact(laws: Laws, p, q):
    """Phase 2, detection: (deepest depth, depth-weighted mean of the penetrating corners)."""
    points = corners(p, q, laws.side)
    depths = np.maximum(-points[:, 2], 0.0)
    if not depths.any():
        return 0.0, None
    return depths.max(), (depths[:, None] * points).sum(axis=0) / depths.sum()


def responded(laws: Laws, r, v, w):
    """Phase 3, response: the velocities after a contact at r from the centre."""
    if laws.model == 'simple':
        if v[2] < 0.0:
            f, e = laws.tangential_factor, laws.restitution
            v = np.array([f * v[0], f * v[1], -e * v[2]])
        return v, w
    inverse_inertia = np.linalg.inv(np.eye(3) * laws.side**2 / 6.0)
    relative = v + np.cross(w, r)
    approach = relative @ NORMAL
    if approach >= 0.0:
        return v, w

    def yielding(d):
        return np.cross(inverse_inertia @ np.cross(r, d), r)

    j_n = -(1.0 + laws.restitution) * approach / (1.0 + NORMAL @ yielding(NORMAL))
    impulse = j_n * NORMAL
    sliding = relative - approach * NORMAL
    speed = math.sqrt(sliding @ sliding)
    if speed >= 1e-12:
        t = sliding / speed
        j_t = laws.friction * (relative @ t) / (r @ np.cross(inverse_inertia @ np.cross(r, t), t))
        impulse = impulse + min(max(j_t, -j_n), j_n) * t
    return v + impulse, w + inverse_inertia @ np.cross(r, impulse)


def stepped(laws: Laws, p, q, v, w):
    """One whole step of one cube."""
    p, q, v, w = moved(laws, p, q, v, w)
    depth, point = contact(laws, p, q)
    if point is not None:
        r = point - p
        p = p + depth * NORMAL
        v, w = responded(laws, r, v, w)
    return p, q, v, w
