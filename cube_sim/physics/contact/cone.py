"""One contact point, exactly: the impulse that Coulomb's cone and a normal velocity ask for."""

from __future__ import annotations

import math

from cube_sim.physics.compiled import compiled

Impulse = tuple[float, float, float]

MOST_HALVINGS = 80


@compiled
def cone_impulse(
    rx: float,
    ry: float,
    rz: float,
    inverse_inertia: float,
    friction: float,
    ux: float,
    uy: float,
    gain: float,
) -> Impulse:
    """
    Return the impulse (x, y, n) of the plane at r that changes the normal velocity by `gain` > 0.

    r is from the centre of a cube of 1 kg to the point, m; (ux, uy) the sliding velocity before,
    m/s. With K = (1 + |r|^2/I) 1 - r r^T/I, u+ = u + K j:

    - sticking, when the cone allows: u_t+ = 0, the solution of the 3x3 system;
    - else sliding, on the cone, against the sliding that is left: |j_t| = mu j_n and
      u_t+ = -lambda j_t with lambda > 0. Eliminating j_n = (gain - k.j_t)/K_nn leaves
      (A + lambda 1) j_t = -c, A = K_tt - k k^T/K_nn, c = u_t + k gain/K_nn, and one equation
      for lambda. As K is positive definite there always is a solution, also for a friction
      at which sliding in the direction from before the impact would jam.
    """
    w = inverse_inertia
    nn = 1.0 + w * (rx * rx + ry * ry)
    frictionless = gain / nn
    if friction == 0.0:
        return 0.0, 0.0, frictionless
    kx = -(w * (rx * rz))
    ky = -(w * (ry * rz))
    axx = (1.0 + w * (ry * ry + rz * rz)) - kx * kx / nn
    ayy = (1.0 + w * (rx * rx + rz * rz)) - ky * ky / nn
    axy = -(w * (rx * ry)) - kx * ky / nn
    cx = ux + kx * frictionless
    cy = uy + ky * frictionless

    det = axx * ayy - axy * axy
    jx = (axy * cy - ayy * cx) / det
    jy = (axy * cx - axx * cy) / det
    jn = (gain - (kx * jx + ky * jy)) / nn
    if jn >= 0.0 and jx * jx + jy * jy <= (friction * jn) * (friction * jn):
        return jx, jy, jn

    # The root in x, lambda = trace (1/x - 1): at x = 1 the cone is violated, at 0 it is not.
    trace = axx + ayy
    low, low_value = 0.0, -(friction * frictionless)
    high, high_value = 1.0, math.sqrt(jx * jx + jy * jy) - friction * jn
    side = 0
    for _ in range(MOST_HALVINGS):
        x = (low * high_value - high * low_value) / (high_value - low_value)
        if not (low < x and x < high):
            break
        shift = trace * (1.0 / x - 1.0)
        bxx = axx + shift
        byy = ayy + shift
        det = bxx * byy - axy * axy
        jx = (axy * cy - byy * cx) / det
        jy = (axy * cx - bxx * cy) / det
        jn = (gain - (kx * jx + ky * jy)) / nn
        value = math.sqrt(jx * jx + jy * jy) - friction * jn
        if abs(value) <= 1e-15 * frictionless:
            break
        # The secant of Illinois: the end that stays twice loses half of its value.
        if value > 0.0:
            high, high_value = x, value
            if side == 1:
                low_value = 0.5 * low_value
            side = 1
        else:
            low, low_value = x, value
            if side == -1:
                high_value = 0.5 * high_value
            side = -1
    return jx, jy, jn
