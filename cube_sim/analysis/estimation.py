"""What a run does, estimated from recorded poses alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.bounces import BOUNCE, approach_speeds, slowest_bounce
from cube_sim.analysis.cubes import REST_NS, Records, is_fast, new_cubes
from cube_sim.analysis.energy import energies, gravity_of
from cube_sim.analysis.findings import POSES, STRETCH, Findings
from cube_sim.analysis.flights import FLIGHT_RECORD, Flights, Meeting
from cube_sim.analysis.sampling import Sample, samples
from cube_sim.physics import Settings

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]
Times = NDArray[np.int64]

# An interval longer than this many of the shortest is a gap: what happened in it is not seen.
_GAP = 2.5
# What a flight began with when it was neither a throw nor a bounce.
_THROW, _NOTHING = -1, -2


def estimate(
    frames: Iterator[tuple[int, Floats]],
    settings: list[tuple[int, Settings]],
    *,
    known: bool = True,
    noise: float = 0.0,
    progress: Callable[[int], None] = lambda messages: None,
) -> Findings:
    """
    Return what can be told from `frames`, times in ns and poses (N, 7), alone.

    `settings` with the times from which they hold, at least one: cube size and gravity, and, if
    they are `known` of the run, the model by whose law to measure. `noise` is the standard
    deviation of a coordinate, m.
    """
    estimator = Estimator(settings, known=known)
    for sample in samples(frames, gravity_of(settings[0][1]), noise):
        estimator.take(sample)
        if estimator.findings.messages % 64 == 0:
            progress(estimator.findings.messages)
    estimator.finish()
    return estimator.findings


class Estimator:
    """Takes samples in turn, finds flights in them, and bounces between those."""

    def __init__(self, settings: list[tuple[int, Settings]], *, known: bool = True) -> None:
        """Begin without cubes, under the first of `settings` (see `estimate`)."""
        self.findings = Findings(POSES, set_known=known)
        self.findings.settings_from_ns = [time_ns for time_ns, _ in settings]
        self.findings.settings = [record for _, record in settings]
        first = settings[0][1]
        self._gravity = gravity_of(first)
        self._size = first.cube_size
        self._shortest_ns = 0
        self._last: Sample | None = None
        self._forget(0)

    def take(self, sample: Sample) -> None:
        """Take the next sample."""
        found = self.findings
        if self._last is not None and sample.generation != self._generation:
            self._write_down(removed=True)
            found.resets_ns.append(self._last.time_ns)
            self._forget(sample.generation)
        if found.messages == 0:
            found.start_ns = sample.time_ns
        if sample.step > 0.0:
            step_ns = round(sample.step * 1e9)
            found.period_ns = min(found.period_ns or step_ns, step_ns)
        found.messages += 1
        found.end_ns = sample.time_ns
        self._enter(sample)
        self._last = sample
        self._watch_speed(sample)
        self._flown(*self._flights.take(sample))
        split = energies(sample.poses, sample.velocities, self._gravity, self._size)
        found.trace.offer(sample.time_ns, sample.generation, sample.poses, sample.velocities, split)

    def finish(self) -> None:
        """Write down the cubes that are still there."""
        self._write_down(removed=False)

    def _forget(self, generation: int) -> None:
        self._generation = generation
        self._flights = Flights(self._gravity)
        self._cubes: Records = new_cubes(0, 0, 0, np.empty((0, 7)))
        # Of each cube: the sample in which it came; the flight before, if any, what that began
        # with, and when.
        self._came: Times = np.empty(0, np.int64)
        self._flight: Records = np.zeros(0, FLIGHT_RECORD)
        self._has_flown: Flags = np.empty(0, bool)
        self._owner: Indices = np.empty(0, np.intp)
        self._since_ns: Times = np.empty(0, np.int64)

    def _enter(self, sample: Sample) -> None:
        known = len(self._cubes)
        added = len(sample.poses) - known
        if not added:
            return
        cubes = new_cubes(sample.generation, known, sample.time_ns, sample.poses[known:])
        cubes['deepest'] = np.nan
        cubes['thrown_energy'] = np.nan
        self._cubes = np.concatenate([self._cubes, cubes])
        self._came = np.append(self._came, np.full(added, self._flights.index + 1))
        self._flight = np.concatenate([self._flight, np.zeros(added, FLIGHT_RECORD)])
        self._has_flown = np.append(self._has_flown, np.zeros(added, bool))
        self._owner = np.append(self._owner, np.full(added, _NOTHING))
        self._since_ns = np.append(self._since_ns, np.full(added, sample.time_ns))

    def _watch_speed(self, sample: Sample) -> None:
        """Note who moves: by the way since the last sample, which no contact can hide."""
        known = ~np.isnan(sample.turn[:, 0])
        before = self._cubes['end_pose']
        if sample.step > 0.0 and known.any():
            mean = np.concatenate([sample.poses[:, :3] - before[:, :3], sample.turn], axis=1)
            fast = known & is_fast(np.nan_to_num(mean) / sample.step, self._size)
            self._cubes['last_fast_ns'][fast] = sample.time_ns
        self._cubes['end_pose'] = sample.poses

    def _flown(self, who: Indices, flights: Records) -> None:
        """Take flights (K,) of the cubes `who` that are over; see what came before each."""
        if not len(who):
            return
        begins = np.full(len(who), _NOTHING, np.intp)
        since_ns = flights['start_ns'].copy()
        first = ~self._has_flown[who]
        from_throw = first & (flights['first'] == self._came[who])
        begins[from_throw] = _THROW
        self._thrown(who[from_throw], flights[from_throw])
        for row in np.flatnonzero(first & ~from_throw):
            self._unclear(who[row], self._cubes['thrown_ns'][who[row]], since_ns[row])

        later = np.flatnonzero(~first)
        if len(later):
            begins[later], since_ns[later] = self._contacts(who[later], flights[later])
        self._flight[who] = flights
        self._has_flown[who] = True
        self._owner[who] = begins
        self._since_ns[who] = since_ns

    def _thrown(self, who: Indices, flights: Records) -> None:
        velocities = np.concatenate([flights['v0'], flights['spin']], axis=1)
        self._cubes['velocity'][who] = velocities
        self._cubes['thrown_energy'][who] = energies(
            self._cubes['pose'][who], velocities, self._gravity, self._size
        )

    def _contacts(self, who: Indices, flights: Records) -> tuple[Indices, Times]:
        """Judge what parts `flights` from those before; return what they begin with, and when."""
        before = self._flight[who]
        meeting = Meeting(before, flights, self._gravity, self._size)
        between_ns = flights['start_ns'] - before['end_ns']
        close = flights['first'] - before['last'] <= 1
        clear = meeting.clear & close & (between_ns <= _GAP * self.findings.period_ns)
        used = np.searchsorted(self.findings.settings_from_ns, meeting.time_ns, side='right') - 1
        used = np.maximum(used, 0)
        models = np.array([record.model for record in self.findings.settings])[used]
        if not self.findings.set_known:
            # Judged by what it does: only a law like that of `simple` leaves the spin alone.
            models = np.where(meeting.keeps_spin, 'simple', '')
        clear &= np.where(models == 'simple', meeting.keeps_spin, meeting.one_impulse)
        begins = np.full(len(who), _NOTHING, np.intp)
        since_ns = np.where(clear, meeting.time_ns, flights['start_ns'])
        self._apexes(who, np.where(clear, meeting.time_ns, before['end_ns']))
        for row in np.flatnonzero(~clear):
            self._unclear(who[row], before['end_ns'][row], flights['start_ns'][row])

        for row in np.flatnonzero(clear):
            one = slice(row, row + 1)
            speed = approach_speeds(meeting.arms[one], meeting.before[one], models[row])[0]
            split = [
                energies(meeting.poses[one], state[one], self._gravity, self._size).sum()
                for state in (meeting.before, meeting.after)
            ]
            cube = self._cubes[who[row]]
            if speed < slowest_bounce(self.findings.settings[used[row]]):
                cube['touches'] += 1
                cube['touched'] += split[1] - split[0]
                continue
            cube['bounces'] += 1
            cube['bounced'] += split[1] - split[0]
            bounce: Records = np.zeros(1, BOUNCE)
            bounce['generation'], bounce['cube'] = self._generation, who[row]
            bounce['time_ns'], bounce['settings'] = meeting.time_ns[row], used[row]
            bounce['position'], bounce['arm'] = meeting.poses[row, :3], meeting.arms[row]
            bounce['before'], bounce['after'] = meeting.before[row], meeting.after[row]
            bounce['depth'] = np.nan
            bounce['lost'] = split[0] - split[1]
            bounce['apex'] = np.nan
            begins[row] = self.findings.bounces.append(bounce)
        return begins, since_ns

    def _apexes(self, who: Indices, until_ns: Times) -> None:
        """Write the apex of the last flight of `who`, over at `until_ns`, to what it began with."""
        fall = self._gravity[2]
        flights = self._flight[who]
        for row, cube in enumerate(who):
            flight, owner = flights[row], self._owner[cube]
            if owner == _NOTHING or fall >= 0.0:
                continue
            seconds = -flight['v0'][2] / fall
            top_ns = int(flight['start_ns']) + round(seconds * 1e9)
            if not self._since_ns[cube] < top_ns < until_ns[row]:
                continue
            top = flight['p0'][2] + 0.5 * flight['v0'][2] * seconds
            record = self._cubes[cube] if owner == _THROW else self.findings.bounces.records[owner]
            record['apex'], record['apex_ns'] = top, top_ns

    def _unclear(self, cube: int, start_ns: int, end_ns: int) -> None:
        stretch: Records = np.zeros(1, STRETCH)
        stretch['generation'], stretch['cube'] = self._generation, cube
        stretch['start_ns'], stretch['end_ns'] = start_ns, end_ns
        self.findings.unclear.append(stretch)
        self._cubes['unclear_stretches'][cube] += 1

    def _write_down(self, *, removed: bool) -> None:
        last = self._last
        if last is None or not len(self._cubes):
            return
        self._flown(*self._flights.close_all())
        cubes = self._cubes
        flown = np.flatnonzero(self._has_flown)
        if len(flown):
            self._apexes(flown, self._flight['end_ns'][flown])
        for cube in range(len(cubes)):
            end_ns = last.time_ns
            if end_ns - cubes['last_fast_ns'][cube] >= REST_NS:
                end_ns = int(cubes['last_fast_ns'][cube])
            since_ns = int(cubes['thrown_ns'][cube])
            if self._has_flown[cube]:
                since_ns = int(self._flight['end_ns'][cube])
                # What ends a flight is a contact, also when the cube lies still after it.
                end_ns = max(end_ns, min(since_ns + self.findings.period_ns, last.time_ns))
            if since_ns < end_ns:
                self._unclear(cube, since_ns, end_ns)
        cubes['ended_ns'] = last.time_ns
        cubes['removed'] = removed
        cubes['end_velocity'] = last.velocities
        cubes['end_energy'] = energies(last.poses, last.velocities, self._gravity, self._size)
        gained = (cubes['end_energy'] - cubes['thrown_energy']).sum(axis=1)
        cubes['unclear'] = gained - cubes['bounced'] - cubes['touched']
        self.findings.cubes.append(cubes)
