"""Quaternions x, y, z, w: the rotation of one step, and composition."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled

Floats = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]

# Taylor coefficients of cos(a) and sin(a)/a in powers of s = a^2. With nine terms the first one
# left out is below 1e-17 for |a| <= pi/4, under half a unit in the last place.
_C1, _C2, _C3, _C4 = -1 / 2, 1 / 24, -1 / 720, 1 / 40_320
_C5, _C6, _C7, _C8 = -1 / 3_628_800, 1 / 479_001_600, -1 / 87_178_291_200, 1 / 20_922_789_888_000
_S1, _S2, _S3, _S4 = -1 / 6, 1 / 120, -1 / 5_040, 1 / 362_880
_S5, _S6, _S7 = -1 / 39_916_800, 1 / 6_227_020_800, -1 / 1_307_674_368_000
_S8 = 1 / 355_687_428_096_000

# Where the series hold: the square of pi/4, rounded up a little.
SERIES_LIMIT = 0.617

# pi/2 in three parts; the first two have 33 significant bits, so that k times them is exact for
# every whole k below 2^20 (the reduction of Cody and Waite).
_TWO_OVER_PI = 0.6366197723675814
_HALF_PI_1 = 1.5707963267341256
_HALF_PI_2 = 6.077100506303966e-11
_HALF_PI_3 = 2.0222662487959506e-21


@compiled
def cosine_series(s: float) -> float:
    """Return cos(a) for s = a^2 <= SERIES_LIMIT."""
    high = _C4 + s * (_C5 + s * (_C6 + s * (_C7 + s * _C8)))
    return 1.0 + s * (_C1 + s * (_C2 + s * (_C3 + s * high)))


@compiled
def sinc_series(s: float) -> float:
    """Return sin(a)/a for s = a^2 <= SERIES_LIMIT."""
    high = _S4 + s * (_S5 + s * (_S6 + s * (_S7 + s * _S8)))
    return 1.0 + s * (_S1 + s * (_S2 + s * (_S3 + s * high)))


@compiled
def cosine_and_sinc(s: float) -> tuple[float, float]:
    """Return cos(a) and sin(a)/a for s = a^2 of any size, with arithmetic alone (no libm)."""
    if s <= SERIES_LIMIT:
        return cosine_series(s), sinc_series(s)
    a = math.sqrt(s)
    quarter_turns = int(a * _TWO_OVER_PI + 0.5)
    k = float(quarter_turns)
    rest = ((a - k * _HALF_PI_1) - k * _HALF_PI_2) - k * _HALF_PI_3
    cosine = cosine_series(rest * rest)
    sine = rest * sinc_series(rest * rest)
    quadrant = quarter_turns & 3
    if quadrant == 0:
        return cosine, sine / a
    if quadrant == 1:
        return -sine, cosine / a
    if quadrant == 2:
        return -cosine, -sine / a
    return sine, -cosine / a


@compiled
def rotor(wx: float, wy: float, wz: float, time_step: float) -> Quaternion:
    """
    Return exp(w dt / 2), the unit quaternion (x, y, z, w) by which a step turns a cube.

    The exact exponential of a spin (wx, wy, wz) that is constant over the step, rad/s, world.
    """
    half = 0.5 * time_step
    half_x = half * wx
    half_y = half * wy
    half_z = half * wz
    cosine, sinc = cosine_and_sinc((half_x * half_x + half_y * half_y) + half_z * half_z)
    return half_x * sinc, half_y * sinc, half_z * sinc, cosine


@compiled
def fill_rotors(
    wx: Floats,
    wy: Floats,
    wz: Floats,
    time_step: float,
    x: Floats,
    y: Floats,
    z: Floats,
    w: Floats,
) -> None:
    """Write to (x, y, z, w) the rotors of the spins (wx, wy, wz): `rotor` for a block of cubes."""
    half = 0.5 * time_step
    fast = 0
    # Without a branch, so that it is one stream of vector instructions; right for all but the
    # few cubes that turn by more than a quarter turn in one step.
    for i in range(len(x)):
        half_x = half * wx[i]
        half_y = half * wy[i]
        half_z = half * wz[i]
        s = (half_x * half_x + half_y * half_y) + half_z * half_z
        sinc = sinc_series(s)
        x[i] = half_x * sinc
        y[i] = half_y * sinc
        z[i] = half_z * sinc
        w[i] = cosine_series(s)
        fast += s > SERIES_LIMIT
    if fast:
        for i in range(len(x)):
            x[i], y[i], z[i], w[i] = rotor(wx[i], wy[i], wz[i], time_step)


@compiled
def composed(
    ax: float,
    ay: float,
    az: float,
    aw: float,
    bx: float,
    by: float,
    bz: float,
    bw: float,
) -> Quaternion:
    """Return the quaternion product a b (first turn by b, then by a)."""
    x = ((aw * bx + ax * bw) + ay * bz) - az * by
    y = ((aw * by - ax * bz) + ay * bw) + az * bx
    z = ((aw * bz + ax * by) - ay * bx) + az * bw
    w = ((aw * bw - ax * bx) - ay * by) - az * bz
    return x, y, z, w


@compiled
def up_row(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """Return the third row of R(q): the heights in world of the three unit axes of the body."""
    return 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)
