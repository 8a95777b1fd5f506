"""Keys that come and come again as the velocity of a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.world import turned_by
from cube_sim.teleop.keys import MOTIONS

Floats = NDArray[np.float64]

# A terminal tells of keys that go down, never of keys that come up. A key that is held comes again
# after up to 0.66 s and then at least every 0.1 s, so the first press holds for longer than that
# and each later one for two repeats. A tap thus flies for all of the first, and does so gently.
FIRST_HOLD = 0.7
NEXT_HOLD = 0.2
TAP_SHARE = 0.3

# Velocities go out this often while the camera flies, s; the simulator stops it after 0.5 s.
PERIOD = 0.05

# Beyond this the camera does not look further up or down, rad.
_STEEPEST = math.radians(85.0)


@dataclass
class _Held:
    """A motion whose key is taken to be down."""

    until: float
    repeated: bool = False


class Flight:
    """The motions that are held now, and the velocity they make."""

    def __init__(self, speed: float, turn: float) -> None:
        """Fly at `speed`, m/s, and turn at `turn`, rad/s, while keys are held."""
        self._speed = speed
        self._turn = turn
        self._held: dict[str, _Held] = {}
        self._flying = False
        self._due = -math.inf

    def press(self, motion: str, now: float) -> None:
        """Take note that a key of one of MOTIONS came; it ends the opposite motion."""
        self._forget(now)
        held = self._held.get(motion)
        if held is None:
            axis, sign = MOTIONS[motion]
            opposite = next(m for m, way in MOTIONS.items() if way == (axis, -sign))
            self._held.pop(opposite, None)
            self._held[motion] = _Held(now + FIRST_HOLD)
            self._due = now
        else:
            self._held[motion] = _Held(max(held.until, now + NEXT_HOLD), repeated=True)

    def due(self, now: float, camera: Floats | None) -> tuple[Floats, Floats] | None:
        """
        Return what to send now, if anything is due: velocity (3,), m/s, and spin (3,), rad/s.

        Both are in the axes of the camera at `camera` (x y z qx qy qz qw). It looks left and right
        about the vertical, so that the horizon stays level. The last one, when no key is held any
        more, is zero.
        """
        self._forget(now)
        if not self._held:
            stop, self._flying = self._flying, False
            return (np.zeros(3), np.zeros(3)) if stop else None
        if now < self._due:
            return None
        self._due = max(self._due + PERIOD, now)
        self._flying = True
        rates = np.zeros(6)
        for motion, held in self._held.items():
            axis, sign = MOTIONS[motion]
            rates[axis] += sign * (1.0 if held.repeated else TAP_SHARE)
        orientation = (0.0, 0.0, 0.0, 1.0) if camera is None else camera[3:]
        pitch = pitch_of(orientation)
        if abs(pitch) > _STEEPEST and rates[4] * pitch > 0.0:
            rates[4] = 0.0
        x, y, z, w = orientation
        upright = turned_by((-x, -y, -z, w), (0.0, 0.0, 1.0))
        spin = np.array([0.0, rates[4], 0.0]) + rates[5] * upright
        return self._speed * rates[:3], self._turn * spin

    def wait(self, now: float) -> float | None:
        """Return how long it is until something is due, s; None when nothing flies."""
        if not self._held:
            return 0.0 if self._flying else None
        ends = min(held.until for held in self._held.values())
        return max(0.0, min(self._due, ends) - now)

    def _forget(self, now: float) -> None:
        self._held = {motion: held for motion, held in self._held.items() if held.until > now}


def pitch_of(orientation: Floats | tuple[float, ...]) -> float:
    """Return by how much x points below the horizon, rad."""
    x, y, z, w = orientation
    return math.asin(max(-1.0, min(1.0, 2.0 * (w * y - x * z))))


def yaw_of(orientation: Floats | tuple[float, ...]) -> float:
    """Return by how much x is turned to the left, seen from above, rad."""
    x, y, z, w = orientation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
