"""What a run is seen to do when it is simulated again step by step: exact in time and place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.bounces import (
    BOUNCE,
    HARD,
    SHORTEST_FLIGHT_NS,
    approach_speeds,
    slowest_bounce,
)
from cube_sim.analysis.cubes import Records, is_fast, new_cubes
from cube_sim.analysis.energy import (
    SEMI_IMPLICIT,
    energies,
    flight_gain,
    gravity_of,
    kinetic_energies,
)
from cube_sim.analysis.findings import REPLAY, Findings
from cube_sim.analysis.replay import Replay
from cube_sim.analysis.timeline import Configured, Posed, Removed, RunTopics, Thrown, timeline
from cube_sim.analysis.touching import contact_arms, lowest_corners
from cube_sim.physics import Settings, World
from cube_sim.physics.rotation import composed, rotor
from cube_sim.recording.reader import BagReader

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Times = NDArray[np.int64]

# A velocity that differs by less than this from free flight was not struck; relative, or m/s.
_ROUNDING = 1e-12
# As a share of the side: a corner that near the plane touches it.
_NEAR = 1e-3

_SUMS = ('flight', 'lift', 'bounced', 'touched', 'changed', 'deepest')
_COUNTS = ('bounces', 'touches', 'deepest_ns', 'last_fast_ns')
_LONG_AGO = -(2**62)


class NotAsRecordedError(Exception):
    """The simulation does not give the poses that were recorded; the message says since when."""


def observe(
    reader: BagReader, progress: Callable[[int, int], None] = lambda done, total: None
) -> Findings:
    """
    Simulate the run of the bag again and return what it does at the resolution of its steps.

    NotAsRecordedError when the recorded poses are others; RecordingError when the bag cannot be
    read or holds no run. `progress` gets messages done and in all.
    """
    topics = RunTopics.of(reader)
    observer = Observer()
    replay = Replay(observer.stepped)
    found = observer.findings
    total = reader.topics[topics.poses].count or 0
    for moment in timeline(reader, topics):
        replay.take(moment)
        if isinstance(moment, Thrown):
            observer.thrown(replay.world, moment.time_ns)
        elif isinstance(moment, Configured):
            observer.configured(replay.world, moment.time_ns)
        elif isinstance(moment, Removed):
            observer.removed(moment.time_ns)
        elif isinstance(moment, Posed):
            if not np.array_equal(moment.poses, replay.world.poses):
                raise NotAsRecordedError(
                    f'from {moment.time_ns / 1e9:.3f} s on the recorded poses are not those '
                    'that the simulation gives (cube_bag verify says which)'
                )
            observer.posed(replay.world, moment.time_ns)
            if found.messages % 64 == 0:
                progress(found.messages, total)
    progress(found.messages, total)
    observer.finish()
    return found


class Observer:
    """Watches a world step by step, and keeps what the record of each cube needs."""

    def __init__(self) -> None:
        """Begin before the first settings."""
        self.findings = Findings(REPLAY)
        self._generation = 0
        self._cubes: Records = new_cubes(0, 0, 0, np.empty((0, 7)))
        self._pose: Floats = np.empty((0, 7))
        self._velocity: Floats = np.empty((0, 6))
        # What changes at every step is kept in arrays of its own, by the names of CUBE.
        self._sums: dict[str, Floats] = {name: np.empty(0) for name in _SUMS}
        self._counts: dict[str, Times] = {name: np.empty(0, np.int64) for name in _COUNTS}
        # Of each cube: its last bounce (-1: none yet), and its greatest height since then.
        self._last_bounce: Indices = np.empty(0, np.intp)
        self._top: Floats = np.empty(0)
        self._top_ns: Times = np.empty(0, np.int64)
        self._event_ns: Times = np.empty(0, np.int64)
        self._touched_ns: Times = np.empty(0, np.int64)
        self._time_ns = 0

    def configured(self, world: World, time_ns: int) -> None:
        """Take the settings of the world from now on."""
        if self.findings.settings and self.findings.settings[-1] == world.settings:
            return
        before = self._energies() if len(self._pose) else None
        self._use(world.settings)
        # Of those that come at one time no step knows but the last.
        if self.findings.settings_from_ns[-1:] == [time_ns]:
            self.findings.settings.pop()
            self.findings.settings_from_ns.pop()
        self.findings.settings.append(world.settings)
        self.findings.settings_from_ns.append(time_ns)
        if before is not None:
            self._sums['changed'] += (self._energies() - before).sum(axis=1)

    def thrown(self, world: World, time_ns: int) -> None:
        """Take in the cubes that have entered the world."""
        known = len(self._pose)
        self._pose, self._velocity = np.array(world.poses), np.array(world.velocities)
        added = len(self._pose) - known
        cubes = new_cubes(self._generation, known, time_ns, self._pose[known:])
        cubes['velocity'] = self._velocity[known:]
        cubes['thrown_energy'] = self._energies()[known:]
        self._cubes = np.concatenate([self._cubes, cubes])
        for name in _SUMS:
            self._sums[name] = np.append(self._sums[name], np.zeros(added))
        for name in _COUNTS:
            self._counts[name] = np.append(self._counts[name], cubes[name])
        self._last_bounce = np.append(self._last_bounce, np.full(added, -1, np.intp))
        self._top = np.append(self._top, self._pose[known:, 2])
        self._top_ns = np.append(self._top_ns, np.full(added, time_ns))
        self._event_ns = np.append(self._event_ns, np.full(added, time_ns))
        self._touched_ns = np.append(self._touched_ns, np.full(added, _LONG_AGO))
        self._time_ns = time_ns

    def removed(self, time_ns: int) -> None:
        """Write down the cubes: there are none any more."""
        self.findings.resets_ns.append(time_ns)
        self._cubes['removed'] = True
        self._write_down(time_ns)
        self._generation += 1
        self._cubes = self._cubes[:0]
        self._pose, self._velocity = self._pose[:0], self._velocity[:0]
        self._sums = {name: values[:0] for name, values in self._sums.items()}
        self._counts = {name: values[:0] for name, values in self._counts.items()}
        self._last_bounce, self._top = self._last_bounce[:0], self._top[:0]
        self._top_ns, self._event_ns = self._top_ns[:0], self._event_ns[:0]
        self._touched_ns = self._touched_ns[:0]

    def posed(self, world: World, time_ns: int) -> None:
        """Count a recorded message, and keep what figures need of it."""
        found = self.findings
        if found.messages == 0:
            found.start_ns = time_ns
        else:
            found.period_ns = found.period_ns or time_ns - found.end_ns
        found.messages += 1
        found.end_ns = self._time_ns = time_ns
        found.trace.offer(
            time_ns, self._generation, world.poses, world.velocities, self._energies()
        )

    def stepped(self, world: World, time_ns: int) -> None:
        """Compare the world with what free flight would have made of it in this step."""
        if not len(self._pose):
            return
        poses, velocities = world.poses, world.velocities
        free = self._velocity + self._gain
        if self._semi_implicit:
            # To the bit: a cube flies free, or it was pushed out of the plane, struck or not.
            height = self._pose[:, 2] + free[:, 2] * self._time_step
            touched = (poses[:, 2] != height) | (velocities != free).any(axis=1)
            self._sums['flight'] += self._flight_gain
        else:
            strange = np.abs(velocities - free) > _ROUNDING * (1.0 + np.abs(free))
            touched = strange.any(axis=1)
        if touched.any():
            self._touch(np.flatnonzero(touched), free, poses, velocities, time_ns)
        higher = poses[:, 2] > self._top
        self._top[higher] = poses[higher, 2]
        self._top_ns[higher] = time_ns
        self._counts['last_fast_ns'][is_fast(velocities, self._size)] = time_ns
        self._pose[:], self._velocity[:] = poses, velocities
        self._time_ns = time_ns

    def finish(self) -> None:
        """Write down the cubes that are still there."""
        self._write_down(self._time_ns)

    def _use(self, settings: Settings) -> None:
        self._model = settings.model
        self._semi_implicit = settings.model in SEMI_IMPLICIT
        constants = settings.constants()
        self._gain = np.array([constants.gain_x, constants.gain_y, constants.gain_z, 0, 0, 0])
        self._time_step = constants.time_step
        self._size = settings.cube_size
        self._gravity = gravity_of(settings)
        self._flight_gain = flight_gain(settings)
        self._slowest = slowest_bounce(settings)

    def _energies(self) -> Floats:
        return energies(self._pose, self._velocity, self._gravity, self._size)

    def _touch(
        self,
        who: Indices,
        free: Floats,
        poses: Floats,
        velocities: Floats,
        time_ns: int,
    ) -> None:
        """Book the contacts of the cubes `who` in this step, and list those that are bounces."""
        before, after = free[who], velocities[who]
        pose = self._free_poses(who, before, poses)
        gained = kinetic_energies(after, self._size) - kinetic_energies(before, self._size)
        if self._semi_implicit:
            depth = poses[who, 2] - pose[:, 2]
            self._sums['lift'][who] -= self._gravity[2] * depth
            on_plane: NDArray[np.bool_] = np.ones(len(who), bool)
        else:
            # Within the step, motion and response are one.
            lowest = lowest_corners(pose, self._size)
            depth = np.maximum(-lowest, 0.0)
            # Struck above the plane, a cube has met another one.
            on_plane = lowest <= _NEAR * self._size
            was = energies(self._pose[who], self._velocity[who], self._gravity, self._size)
            now = energies(poses[who], after, self._gravity, self._size)
            gained = (now - was).sum(axis=1)
        deeper = depth > self._sums['deepest'][who]
        self._sums['deepest'][who[deeper]] = depth[deeper]
        self._counts['deepest_ns'][who[deeper]] = time_ns

        arms = contact_arms(pose, self._size)
        struck = (before != after).any(axis=1)
        speed = approach_speeds(arms, before, self._model)
        flew = time_ns - self._touched_ns[who] >= SHORTEST_FLIGHT_NS
        bounced = struck & on_plane & (speed >= self._slowest) & (flew | (speed >= HARD))
        self._touched_ns[who] = time_ns
        touched = ~bounced
        self._sums['touched'][who[touched]] += gained[touched]
        self._counts['touches'][who[touched & struck]] += 1
        if bounced.any():
            self._sums['bounced'][who[bounced]] += gained[bounced]
            rows: Records = np.zeros(int(bounced.sum()), BOUNCE)
            rows['generation'] = self._generation
            rows['cube'] = who[bounced]
            rows['time_ns'] = time_ns
            rows['settings'] = len(self.findings.settings) - 1
            rows['position'] = pose[bounced, :3]
            rows['arm'] = arms[bounced]
            rows['before'], rows['after'] = before[bounced], after[bounced]
            rows['depth'] = depth[bounced]
            rows['lost'] = -gained[bounced]
            rows['apex'] = np.nan
            self._bounce(who[bounced], rows, poses, time_ns)

    def _bounce(self, who: Indices, rows: Records, poses: Floats, time_ns: int) -> None:
        self._close_flights(who)
        first = self.findings.bounces.append(rows)
        self._last_bounce[who] = first + np.arange(len(who))
        self._counts['bounces'][who] += 1
        self._top[who] = poses[who, 2]
        self._top_ns[who] = time_ns
        self._event_ns[who] = time_ns

    def _free_poses(self, who: Indices, free: Floats, poses: Floats) -> Floats:
        """Return the poses at the end of the step as they were before the response."""
        pose = poses[who]
        pose[:, :3] = self._pose[who, :3] + free[:, :3] * self._time_step
        if not self._semi_implicit:
            # The turn may have been answered within the step: take the free one.
            for row, cube in enumerate(who):
                wx, wy, wz = self._velocity[cube, 3:]
                turn = rotor(wx, wy, wz, self._time_step)
                pose[row, 3:] = composed(*turn, *self._pose[cube, 3:])
        return pose

    def _close_flights(self, who: Indices) -> None:
        """Write the apex of the flights that end now to the throw or bounce they began with."""
        # The height at the beginning is no apex: the cube has only fallen since.
        rose = who[self._top_ns[who] > self._event_ns[who]]
        if not len(rose):
            return
        owner = self._last_bounce[rose]
        thrown, bounced = rose[owner < 0], rose[owner >= 0]
        self._cubes['apex'][thrown] = self._top[thrown]
        self._cubes['apex_ns'][thrown] = self._top_ns[thrown]
        bounces = self.findings.bounces.records
        bounces['apex'][self._last_bounce[bounced]] = self._top[bounced]
        bounces['apex_ns'][self._last_bounce[bounced]] = self._top_ns[bounced]

    def _write_down(self, time_ns: int) -> None:
        if not len(self._pose):
            return
        self._close_flights(np.arange(len(self._pose)))
        for name in _SUMS:
            self._cubes[name] = self._sums[name]
        for name in _COUNTS:
            self._cubes[name] = self._counts[name]
        self._cubes['ended_ns'] = time_ns
        self._cubes['end_pose'] = self._pose
        self._cubes['end_velocity'] = self._velocity
        self._cubes['end_energy'] = self._energies()
        self.findings.cubes.append(self._cubes)
