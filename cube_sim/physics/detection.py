"""Where a cube touches the plane z = 0."""

from __future__ import annotations

from cube_sim.physics.compiled import compiled
from cube_sim.physics.rotation import up_row


@compiled
def lowest_corner(pz: float, qx: float, qy: float, qz: float, qw: float, half_side: float) -> float:
    """Return the height of the lowest corner of a cube whose centre is at height pz, m."""
    up_x, up_y, up_z = up_row(qx, qy, qz, qw)
    return pz - ((abs(half_side * up_x) + abs(half_side * up_y)) + abs(half_side * up_z))


@compiled
def contact_point(
    pz: float, qx: float, qy: float, qz: float, qw: float, half_side: float
) -> tuple[float, float, float]:
    """
    Return r, from the centre to the contact point of a penetrating cube, m, frame world.

    The contact point is the mean of the penetrating corners, each weighted by its depth
    d_k = -z_k: P_c = sum(d_k x_k) / sum(d_k).
    """
    # The columns of R times half a side: from the centre to the middle of three faces.
    ax = half_side * (1.0 - 2.0 * (qy * qy + qz * qz))
    ay = half_side * (2.0 * (qx * qy + qz * qw))
    bx = half_side * (2.0 * (qx * qy - qz * qw))
    by = half_side * (1.0 - 2.0 * (qx * qx + qz * qz))
    cx = half_side * (2.0 * (qx * qz + qy * qw))
    cy = half_side * (2.0 * (qy * qz - qx * qw))
    up_x, up_y, up_z = up_row(qx, qy, qz, qw)
    az, bz, cz = half_side * up_x, half_side * up_y, half_side * up_z

    total = 0.0
    sum_x = 0.0
    sum_y = 0.0
    sum_z = 0.0
    for i in (-1.0, 1.0):
        for j in (-1.0, 1.0):
            for k in (-1.0, 1.0):
                corner_z = (i * az + j * bz) + k * cz
                depth = -(pz + corner_z)
                if depth > 0.0:
                    total += depth
                    sum_x += depth * ((i * ax + j * bx) + k * cx)
                    sum_y += depth * ((i * ay + j * by) + k * cy)
                    sum_z += depth * corner_z
    return sum_x / total, sum_y / total, sum_z / total
