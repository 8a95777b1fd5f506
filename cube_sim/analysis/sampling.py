"""Recorded poses as they pass by: where they fly free, and how fast, as far as poses can tell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Where a velocity comes from.
UNKNOWN, FLIGHT, DIFFERENCE = 0, 1, 2

# Three poses count as free flight when their second difference is that of gravity within this, m.
FLIGHT_TOLERANCE = 1e-6


@dataclass
class Sample:
    """
    The poses (N, 7) recorded at `time_ns`, with what their neighbours say about them.

    `flies` (N,): this pose, the one before and the one after lie on one parabola. `begins` and
    `ends` (N,): this pose is the first or the last of a flight, or, at a contact right here, the
    last of one and the first of another. `turn` (N, 3) is the rotation since the sample before as
    a rotation vector, rad, world; `step` the time since then, s (0 for the first of a
    generation). `velocities` (N, 6) as in cube_sim.physics, and `source` (N,) where each comes
    from.
    """

    time_ns: int
    generation: int
    poses: Floats
    step: float
    turn: Floats
    flies: Flags
    begins: Flags
    ends: Flags
    velocities: Floats
    source: NDArray[np.uint8]


def samples(
    frames: Iterable[tuple[int, Floats]], gravity: Floats, noise: float = 0.0
) -> Iterator[Sample]:
    """
    Yield a Sample for each of `frames` (time in ns, poses (N, 7)), two frames late.

    `gravity` (3,) m/s^2; `noise` is the standard deviation of a coordinate, m. Fewer cubes than
    before mean that there was a reset; frames that are not later than the one before are left out.
    """
    # A second difference a - 2 b + c of independent errors has sqrt(6) times their deviation.
    tolerance = max(FLIGHT_TOLERANCE, 5.0 * np.sqrt(6.0) * noise)
    # The one that was yielded last, and those that wait for what comes after them.
    before: Sample | None = None
    waiting: list[Sample] = []
    generation = 0
    for time_ns, poses in frames:
        last = waiting[-1] if waiting else None
        if last is not None and time_ns <= last.time_ns:
            continue
        if last is not None and len(poses) < len(last.poses):
            yield from _completed(before, waiting, gravity)
            generation += 1
            before, waiting, last = None, [], None
        sample = _sample(time_ns, generation, poses, last)
        waiting.append(sample)
        centre = waiting[-2] if len(waiting) > 1 else None
        first = waiting[-3] if len(waiting) > 2 else before
        if centre is not None and first is not None:
            known = len(first.poses)
            centre.flies[:known] = _is_parabola(first, centre, sample, gravity, tolerance)
        if len(waiting) > 2:
            _complete(before, waiting[0], waiting[1], gravity)
            before = waiting.pop(0)
            yield before
    yield from _completed(before, waiting, gravity)


def _sample(time_ns: int, generation: int, poses: Floats, last: Sample | None) -> Sample:
    count = len(poses)
    turn = np.full((count, 3), np.nan)
    step = 0.0
    if last is not None:
        step = (time_ns - last.time_ns) / 1e9
        known = len(last.poses)
        turn[:known] = rotation_vectors(last.poses[:, 3:], poses[:known, 3:])
    return Sample(
        time_ns,
        generation,
        np.array(poses, np.float64),
        step,
        turn,
        flies=np.zeros(count, bool),
        begins=np.zeros(count, bool),
        ends=np.zeros(count, bool),
        velocities=np.full((count, 6), np.nan),
        source=np.full(count, UNKNOWN, np.uint8),
    )


def _is_parabola(
    first: Sample, centre: Sample, last: Sample, gravity: Floats, tolerance: float
) -> Flags:
    """Return which cubes of `first` fly free over the three samples."""
    count = len(first.poses)
    later = (last.poses[:count, :3] - centre.poses[:count, :3]) / last.step
    earlier = (centre.poses[:count, :3] - first.poses[:, :3]) / centre.step
    kink = later - earlier - gravity * (0.5 * (last.step + centre.step))
    size = np.abs(kink) * min(last.step, centre.step)
    rounding = 1e-14 * np.abs(centre.poses[:count, :3])
    free: Flags = np.all(size <= tolerance + rounding, axis=1)
    return free


def _completed(before: Sample | None, waiting: list[Sample], gravity: Floats) -> Iterator[Sample]:
    for place, sample in enumerate(waiting):
        after = waiting[place + 1] if place + 1 < len(waiting) else None
        _complete(before, sample, after, gravity)
        before = sample
        yield sample


def _complete(before: Sample | None, sample: Sample, after: Sample | None, gravity: Floats) -> None:
    """Fill in what the neighbours tell: flights that begin or end here, and the velocities."""
    count = len(sample.poses)
    known = len(before.poses) if before is not None else 0
    backward: Floats = np.full((count, 6), np.nan)
    forward: Floats = np.full((count, 6), np.nan)
    flew: Flags = np.zeros(count, bool)
    will_fly: Flags = np.zeros(count, bool)
    fall_before: Floats = np.zeros(3)
    fall_after: Floats = np.zeros(3)
    if before is not None:
        flew[:known] = before.flies
        backward[:known, :3] = (sample.poses[:known, :3] - before.poses[:, :3]) / sample.step
        backward[:, 3:] = sample.turn / sample.step
        fall_before = gravity * (0.5 * sample.step)
    if after is not None:
        will_fly = after.flies[:count]
        forward[:, :3] = (after.poses[:count, :3] - sample.poses[:, :3]) / after.step
        forward[:, 3:] = after.turn[:count] / after.step
        fall_after = gravity * (0.5 * after.step)
    sample.ends = flew & ~sample.flies
    sample.begins = will_fly & ~sample.flies

    # The mean over an interval of free flight is the velocity in its middle.
    flown, flying = np.array(backward), np.array(forward)
    flown[:, :3] += fall_before
    flying[:, :3] -= fall_after
    centred = np.where(np.isnan(backward), forward, backward)
    both = ~np.isnan(backward[:, 0]) & ~np.isnan(forward[:, 0])
    centred[both] = 0.5 * (backward[both] + forward[both])
    free = sample.flies[:, None]
    # Where a flight meets the next one the velocity is that after the contact.
    estimated = np.where(will_fly[:, None], flying, np.where(flew[:, None], flown, centred))
    sample.velocities = np.where(free, 0.5 * (flown + flying), estimated)
    in_flight = sample.flies | will_fly | flew
    has_velocity = ~np.isnan(sample.velocities[:, 0])
    sample.source = np.where(in_flight, FLIGHT, DIFFERENCE).astype(np.uint8)
    sample.source[~has_velocity] = UNKNOWN


def rotation_vectors(first: Floats, second: Floats) -> Floats:
    """Return the turns (N, 3), rad, world, by the shorter way from one (N, 4) to the other."""
    ax, ay, az, aw = -first[:, 0], -first[:, 1], -first[:, 2], first[:, 3]
    bx, by, bz, bw = second.T
    vector = np.stack(
        [
            bw * ax + bx * aw + by * az - bz * ay,
            bw * ay - bx * az + by * aw + bz * ax,
            bw * az + bx * ay - by * ax + bz * aw,
        ],
        axis=1,
    )
    scalar = bw * aw - bx * ax - by * ay - bz * az
    vector *= np.where(scalar < 0.0, -1.0, 1.0)[:, None]
    sine = np.sqrt(np.sum(vector * vector, axis=1))
    angle = 2.0 * np.arctan2(sine, np.abs(scalar))
    scale = np.full(len(sine), 2.0)
    np.divide(angle, sine, out=scale, where=sine > 1e-12)
    turns: Floats = vector * scale[:, None]
    return turns
