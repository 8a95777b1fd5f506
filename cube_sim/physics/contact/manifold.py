"""The points in which two cubes touch: a clipped face, or one point of two crossing edges."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.axes import FIRST_EDGE, IN_A, IN_B
from cube_sim.physics.contact.layout import (
    KEPT_MEAN,
    KEPT_N,
    LOCAL_A,
    LOCAL_B,
    LOCAL_NORMAL,
    MOST_POINTS,
    PAIR_POINT,
    PAIR_POINT_COLUMNS,
)

Floats = NDArray[np.float64]

# Rows of the scratch: the polygon and its copy while it is cut, u v along the face and the
# height above it; the points of the last step; those that are kept.
POLYGON, COPY, LAST = 16, 17, 24
# In half sides: a point this near to one of the last step takes over its impulses; corners of a
# face this near to each other are one point.
SAME, MERGED = 0.1, 0.01
# How many impulses a point keeps: in a row of the scratch they stand behind its two places.
KEPT = KEPT_MEAN - KEPT_N + 1


@compiled
def cut(source: Floats, count: int, axis: int, sign: float, limit: float, target: Floats) -> int:
    """Cut a polygon of rows u, v, height to sign * (u or v) <= limit; return its corners."""
    kept = 0
    for n in range(count):
        m = n + 1 if n + 1 < count else 0
        here = sign * source[3 * n + axis] - limit
        there = sign * source[3 * m + axis] - limit
        if here <= 0.0:
            for k in range(3):
                target[3 * kept + k] = source[3 * n + k]
            kept += 1
        if (here <= 0.0) != (there <= 0.0):
            share = here / (here - there)
            for k in range(3):
                target[3 * kept + k] = source[3 * n + k] + share * (
                    source[3 * m + k] - source[3 * n + k]
                )
            kept += 1
    return kept


@compiled
def face_points(
    place: Floats, axis: int, half_side: float, margin: float, row: Floats, scratch: Floats
) -> int:
    """
    Write the points of a face contact to a row of `pairs` and return their number, up to 8.

    The face of the reference cube that looks at the other; of the other the face that looks
    back, cut to the column above the first; its corners lower than `margin` are points. The one
    on the reference cube lies vertically below, on its face.
    """
    h = half_side
    flipped = axis >= 3
    r = axis - 3 if flipped else axis
    way = IN_B if flipped else IN_A
    # From the reference cube to the other, in the axes of the reference.
    direction = -1.0 if flipped else 1.0
    sign = 1.0 if direction * place[way + r] >= 0.0 else -1.0
    u, v = (r + 1) % 3, (r + 2) % 3

    # The axes of the other in those of the reference: m(i, k) = reference_i . other_k.
    row_step = 1 if flipped else 3
    column_step = 3 if flipped else 1
    steepest, incident = -1.0, 0
    for k in range(3):
        cosine = abs(place[row_step * r + column_step * k])
        if cosine > steepest:
            steepest, incident = cosine, k
    facing = -1.0 if sign * place[row_step * r + column_step * incident] >= 0.0 else 1.0
    k1, k2 = (incident + 1) % 3, (incident + 2) % 3
    polygon, copy = scratch[POLYGON], scratch[COPY]
    for n in range(4):
        s1 = 1.0 if n == 0 or n == 3 else -1.0
        s2 = 1.0 if n < 2 else -1.0
        for k in range(3):
            i = u if k == 0 else (v if k == 1 else r)
            base = row_step * i
            value = direction * place[way + i] + h * (
                facing * place[base + column_step * incident]
                + (s1 * place[base + column_step * k1] + s2 * place[base + column_step * k2])
            )
            polygon[3 * n + k] = sign * value - h if k == 2 else value
    count = cut(polygon, 4, 0, 1.0, h, copy)
    count = cut(copy, count, 0, -1.0, h, polygon)
    count = cut(polygon, count, 1, 1.0, h, copy)
    count = cut(copy, count, 1, -1.0, h, polygon)
    kept = low_corners(polygon, count, margin, MERGED * h)

    for k in range(3):
        row[LOCAL_NORMAL + k] = 0.0
    # The normal from the first cube to the second, in the axes of the first.
    if flipped:
        for i in range(3):
            row[LOCAL_NORMAL + i] = -(sign * place[3 * i + r])
    else:
        row[LOCAL_NORMAL + r] = sign
    mine = LOCAL_B if flipped else LOCAL_A
    other = LOCAL_A if flipped else LOCAL_B
    for n in range(kept):
        at = PAIR_POINT + n * PAIR_POINT_COLUMNS
        row[at + mine + u] = polygon[3 * n]
        row[at + mine + v] = polygon[3 * n + 1]
        row[at + mine + r] = sign * h
        # The same on the other cube: in its axes, from its centre.
        x = polygon[3 * n] - direction * place[way + u]
        y = polygon[3 * n + 1] - direction * place[way + v]
        z = sign * (polygon[3 * n + 2] + h) - direction * place[way + r]
        for k in range(3):
            row[at + other + k] = (
                x * place[row_step * u + column_step * k]
                + y * place[row_step * v + column_step * k]
            ) + z * place[row_step * r + column_step * k]
    return kept


@compiled
def low_corners(polygon: Floats, count: int, margin: float, merged: float) -> int:
    """
    Keep the corners lower than `margin`, m, and return their number.

    Of those within `merged`, m, of each other one is kept: two squares that are hardly turned
    against each other cut every corner twice.
    """
    kept = 0
    for n in range(count):
        if polygon[3 * n + 2] >= margin:
            continue
        alone = True
        for m in range(kept):
            x = polygon[3 * n] - polygon[3 * m]
            y = polygon[3 * n + 1] - polygon[3 * m + 1]
            if x * x + y * y < merged * merged:
                alone = False
                polygon[3 * m + 2] = min(polygon[3 * m + 2], polygon[3 * n + 2])
        if alone and kept < MOST_POINTS:
            for k in range(3):
                polygon[3 * kept + k] = polygon[3 * n + k]
            kept += 1
    return kept


@compiled
def edge_point(place: Floats, axis: int, half_side: float, row: Floats) -> int:
    """Write the one point of two crossing edges to a row of `pairs`; return 1."""
    i = (axis - FIRST_EDGE) // 3
    j = (axis - FIRST_EDGE) % 3
    i1, i2 = (i + 1) % 3, (i + 2) % 3
    j1, j2 = (j + 1) % 3, (j + 2) % 3
    cosine = place[3 * i + j]
    scale = 1.0 / math.sqrt(1.0 - cosine * cosine)
    # a_i x b_j = -C[i2, j] a_i1 + C[i1, j] a_i2, turned towards the second cube.
    n1, n2 = -(place[3 * i2 + j] * scale), place[3 * i1 + j] * scale
    if place[IN_A + i1] * n1 + place[IN_A + i2] * n2 < 0.0:
        n1, n2 = -n1, -n2
    row[LOCAL_NORMAL + i] = 0.0
    row[LOCAL_NORMAL + i1] = n1
    row[LOCAL_NORMAL + i2] = n2
    # The middles of the two edges: on the first towards the normal, on the second against it.
    a1 = half_side if n1 >= 0.0 else -half_side
    a2 = half_side if n2 >= 0.0 else -half_side
    b1 = half_side if n1 * place[3 * i1 + j1] + n2 * place[3 * i2 + j1] < 0.0 else -half_side
    b2 = half_side if n1 * place[3 * i1 + j2] + n2 * place[3 * i2 + j2] < 0.0 else -half_side
    # From the one to the other, along a_i and along b_j.
    along_a = place[IN_A + i] + (b1 * place[3 * i + j1] + b2 * place[3 * i + j2])
    along_b = place[IN_B + j] - (a1 * place[3 * i1 + j] + a2 * place[3 * i2 + j])
    square = 1.0 - cosine * cosine
    s = (along_a - cosine * along_b) / square
    t = (cosine * along_a - along_b) / square
    s = min(max(s, -half_side), half_side)
    t = min(max(t, -half_side), half_side)
    at = PAIR_POINT
    row[at + LOCAL_A + i] = s
    row[at + LOCAL_A + i1] = a1
    row[at + LOCAL_A + i2] = a2
    row[at + LOCAL_B + j] = t
    row[at + LOCAL_B + j1] = b1
    row[at + LOCAL_B + j2] = b2
    return 1


@compiled
def remember_points(row: Floats, count: int, scratch: Floats) -> None:
    """Put the points of the last step, with their impulses, aside."""
    for n in range(count):
        at = PAIR_POINT + n * PAIR_POINT_COLUMNS
        for k in range(6):
            scratch[LAST + n, k] = row[at + LOCAL_A + k]
        for k in range(KEPT):
            scratch[LAST + n, 6 + k] = row[at + KEPT_N + k]


@compiled
def recall_impulses(row: Floats, count: int, last: int, half_side: float, scratch: Floats) -> None:
    """
    Give the impulses of each point of the last step to the point that is nearest to it now.

    To that all of them, for what is lost of a load makes a cube fall.
    """
    for n in range(count):
        at = PAIR_POINT + n * PAIR_POINT_COLUMNS
        for k in range(KEPT):
            row[at + KEPT_N + k] = 0.0
    for m in range(last):
        best, nearest = (SAME * half_side) * (SAME * half_side), -1
        for n in range(count):
            at = PAIR_POINT + n * PAIR_POINT_COLUMNS
            a = 0.0
            b = 0.0
            for k in range(3):
                d = row[at + LOCAL_A + k] - scratch[LAST + m, k]
                e = row[at + LOCAL_B + k] - scratch[LAST + m, 3 + k]
                a += d * d
                b += e * e
            if min(a, b) < best:
                best, nearest = min(a, b), n
        if nearest >= 0:
            at = PAIR_POINT + nearest * PAIR_POINT_COLUMNS
            for k in range(KEPT):
                row[at + KEPT_N + k] += scratch[LAST + m, 6 + k]
