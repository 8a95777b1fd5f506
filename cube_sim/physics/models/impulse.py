"""Model `impulse`: the report's "réponse complexe", one contact point with Coulomb's clamp."""

from __future__ import annotations

import math

from cube_sim.physics.compiled import compiled
from cube_sim.physics.constants import Constants, Velocities

CODE = 1

# Below this sliding speed there is no direction to speak of, and no friction impulse, m/s.
NO_SLIDING = 1e-12


@compiled
def respond(
    constants: Constants,
    rx: float,
    ry: float,
    rz: float,
    vx: float,
    vy: float,
    vz: float,
    wx: float,
    wy: float,
    wz: float,
) -> Velocities:
    """
    Return the velocities after a contact at r = (rx, ry, rz) from the centre.

    With v_r = v + w x r at the contact point and n = (0, 0, 1), only if v_r.n < 0:
    j_n = -(1 + e) v_r.n / (1/m + n.(I^-1 (r x n) x r)) along n, and along the sliding
    direction t j_t = mu v_r.t / (r.(I^-1 (r x t) x t)), clamped to [-j_n, j_n]. Both come
    from the same v_r; m = 1 kg. A cube at rest may hop: that is part of the model.
    """
    sliding_x = vx + (wy * rz - wz * ry)
    sliding_y = vy + (wz * rx - wx * rz)
    approach = vz + (wx * ry - wy * rx)
    if approach < 0.0:
        inverse_inertia = constants.inverse_inertia
        j_n = -((1.0 + constants.restitution) * approach) / (
            1.0 + inverse_inertia * (rx * rx + ry * ry)
        )
        vz = vz + j_n
        wx = wx + inverse_inertia * (ry * j_n)
        wy = wy - inverse_inertia * (rx * j_n)

        speed = math.sqrt(sliding_x * sliding_x + sliding_y * sliding_y)
        if speed >= NO_SLIDING:
            tx = sliding_x / speed
            ty = sliding_y / speed
            # a = r x t; r.(a x t) = -(a.a) <= 0, which is why j_t opposes the sliding.
            ax = -(rz * ty)
            ay = rz * tx
            az = rx * ty - ry * tx
            j_t = constants.friction * speed / -(inverse_inertia * ((ax * ax + ay * ay) + az * az))
            j_t = min(max(j_t, -j_n), j_n)
            vx = vx + j_t * tx
            vy = vy + j_t * ty
            wx = wx + inverse_inertia * (j_t * ax)
            wy = wy + inverse_inertia * (j_t * ay)
            wz = wz + inverse_inertia * (j_t * az)
    return vx, vy, vz, wx, wy, wz
