"""Free flights among recorded poses: their parabolas, and the bounces where two of them meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.cubes import Records
from cube_sim.analysis.sampling import Sample
from cube_sim.analysis.touching import contact_arms, lowest_corners

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A run of samples of one cube on one parabola p0 + v0 t + g t^2 / 2, t from `start_ns`. The sums
# are those of a straight line through p - g t^2 / 2; `first` and `last` count samples.
FLIGHT_RECORD = np.dtype(
    [
        ('start_ns', np.int64),
        ('end_ns', np.int64),
        ('first', np.int64),
        ('last', np.int64),
        ('n', np.float64),
        ('t', np.float64),
        ('tt', np.float64),
        ('p', np.float64, 3),
        ('tp', np.float64, 3),
        ('turn', np.float64, 3),
        ('turn_time', np.float64),
        ('start_orientation', np.float64, 4),
        ('end_orientation', np.float64, 4),
        ('p0', np.float64, 3),
        ('v0', np.float64, 3),
        ('spin', np.float64, 3),
    ]
)

# How far from the plane a contact may seem to be, as a share of the cube's side: a cube sinks in
# by up to its speed times the time step before it is pushed out.
_CLEARANCE = 0.1
# How well one impulse at the contact point must explain the change of spin: what is left over, as
# the speed of a face, compared with the change of velocity. Two contacts leave more than 0.25.
_ONE_IMPULSE = 0.1
# Corners within this share of the side of the lowest one count as touching.
_SLACK = 0.01


def fit(flights: Records) -> None:
    """Fill in `p0`, `v0` and `spin` of the flights (K,) by least squares."""
    n, t, tt = flights['n'], flights['t'], flights['tt']
    slope = (n[:, None] * flights['tp'] - t[:, None] * flights['p']) / (n * tt - t * t)[:, None]
    flights['v0'] = slope
    flights['p0'] = (flights['p'] - slope * t[:, None]) / n[:, None]
    flights['spin'] = flights['turn'] / flights['turn_time'][:, None]


def states_at(flights: Records, times: Floats, gravity: Floats) -> tuple[Floats, Floats, Floats]:
    """Return positions, linear and angular velocities (K, 3) at `times` (K,), s from `start_ns`."""
    t = times[:, None]
    position = flights['p0'] + flights['v0'] * t + 0.5 * gravity * (t * t)
    return position, flights['v0'] + gravity * t, flights['spin']


def turned(orientations: Floats, spins: Floats, seconds: Floats) -> Floats:
    """Return orientations (K, 4) after turning by spins (K, 3), rad/s, for `seconds` (K,)."""
    half = 0.5 * spins * seconds[:, None]
    angle = np.sqrt(np.sum(half * half, axis=1))
    sinc = np.sinc(angle / np.pi)
    ax, ay, az = (half * sinc[:, None]).T
    aw = np.cos(angle)
    bx, by, bz, bw = orientations.T
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=1,
    )


class Meeting:
    """
    Where the parabolas of flights (K,) before and after a contact meet.

    `clear` (K,) tells whether it makes sense: between the two flights, and with the cube on the
    plane. One contact then either leaves the spin alone (`keeps_spin`) or gives one impulse at
    the contact point, I dw = r x m dv (`one_impulse`); what fits neither was more than one.
    """

    def __init__(self, earlier: Records, later: Records, gravity: Floats, cube_size: float) -> None:
        """Compute the meetings; the flights must have been fitted."""
        shift = (later['start_ns'] - earlier['start_ns']) / 1e9
        # Both fall alike, so that their distance is linear in time: it is least where
        # |d + dv t|, the distance at the start of the earlier one and its rate, is.
        position, velocity, _ = states_at(later, -shift, gravity)
        apart = position - earlier['p0']
        rate = velocity - earlier['v0']
        square = np.sum(rate * rate, axis=1)
        seconds: Floats = np.full(len(earlier), np.nan)
        np.divide(-np.sum(apart * rate, axis=1), square, out=seconds, where=square > 0.0)
        since_end = seconds - (earlier['end_ns'] - earlier['start_ns']) / 1e9
        between = (later['start_ns'] - earlier['end_ns']) / 1e9
        slack = 0.25 * np.maximum(between, 1e-3)
        inside = (since_end >= -slack) & (since_end <= between + slack)

        seconds = np.where(inside, seconds, 0.0)
        self.time_ns = earlier['start_ns'] + np.round(seconds * 1e9).astype(np.int64)
        place, before, spin_before = states_at(earlier, seconds, gravity)
        _, after, spin_after = states_at(later, seconds - shift, gravity)
        self.before = np.concatenate([before, spin_before], axis=1)
        self.after = np.concatenate([after, spin_after], axis=1)
        since_end = np.where(inside, since_end, 0.0)
        orientation = turned(earlier['end_orientation'], earlier['spin'], since_end)
        self.poses = np.concatenate([place, orientation], axis=1)
        lowest = lowest_corners(self.poses, cube_size)
        self.depth = np.maximum(-lowest, 0.0)
        self.arms = contact_arms(self.poses, cube_size, _SLACK * cube_size)
        change = self.after - self.before
        limit = _ONE_IMPULSE * np.linalg.norm(change[:, :3], axis=1)
        yielding = 6.0 / (cube_size * cube_size)
        rest = change[:, 3:] - yielding * np.cross(self.arms, change[:, :3])
        self.keeps_spin: Flags = _face_speed(change[:, 3:], cube_size) <= limit
        self.one_impulse: Flags = _face_speed(rest, cube_size) <= limit
        self.clear: Flags = inside & (np.abs(lowest) <= _CLEARANCE * cube_size)


def _face_speed(spins: Floats, cube_size: float) -> Floats:
    speeds: Floats = 0.5 * cube_size * np.linalg.norm(spins, axis=1)
    return speeds


class Flights:
    """The flights that are open, one at most for each cube, and the last one that was closed."""

    def __init__(self, gravity: Floats) -> None:
        """Begin without cubes; `gravity` (3,), m/s^2."""
        self._gravity = gravity
        self.open: Records = np.zeros(0, FLIGHT_RECORD)
        self.is_open: Flags = np.zeros(0, bool)
        self.index = -1

    def take(self, sample: Sample) -> tuple[NDArray[np.intp], Records]:
        """Take a sample; return the cubes (K,) whose flight it ends, and those flights, fitted."""
        self.index += 1
        added = len(sample.poses) - len(self.open)
        if added:
            self.open = np.concatenate([self.open, np.zeros(added, FLIGHT_RECORD)])
            self.is_open = np.concatenate([self.is_open, np.zeros(added, bool)])
        self._add(np.flatnonzero(self.is_open & (sample.flies | sample.ends)), sample)
        ended = np.flatnonzero(self.is_open & sample.ends)
        closed = self._close(ended)
        begins = np.flatnonzero(sample.begins)
        self.open[begins] = np.zeros(1, FLIGHT_RECORD)
        self.open['start_ns'][begins] = sample.time_ns
        self.open['first'][begins] = self.index
        self.open['start_orientation'][begins] = sample.poses[begins, 3:]
        self.is_open[begins] = True
        self._add(begins, sample)
        return ended, closed

    def close_all(self) -> tuple[NDArray[np.intp], Records]:
        """Return the cubes whose flight is still open, and those flights, fitted."""
        ended = np.flatnonzero(self.is_open)
        return ended, self._close(ended)

    def _add(self, who: NDArray[np.intp], sample: Sample) -> None:
        flights = self.open[who]
        t = (sample.time_ns - flights['start_ns']) / 1e9
        p = sample.poses[who, :3] - 0.5 * self._gravity * (t * t)[:, None]
        flights['n'] += 1.0
        flights['t'] += t
        flights['tt'] += t * t
        flights['p'] += p
        flights['tp'] += t[:, None] * p
        later = flights['first'] != self.index
        flights['turn'][later] += sample.turn[who[later]]
        flights['turn_time'][later] += sample.step
        flights['end_ns'] = sample.time_ns
        flights['last'] = self.index
        flights['end_orientation'] = sample.poses[who, 3:]
        self.open[who] = flights

    def _close(self, who: NDArray[np.intp]) -> Records:
        closed = self.open[who]
        self.is_open[who] = False
        fit(closed)
        return closed
