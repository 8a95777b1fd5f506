"""Where two recordings part, by value."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.timeline import pose_topic
from cube_sim.analysis.verification import POSE_FIELDS
from cube_sim.messages.decode import MessageError, read_pose_array
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

Floats = NDArray[np.float64]

# Distances at which to say when two runs were first that far apart, m.
MILESTONES = (1e-9, 1e-6, 1e-3, 1e-1)


@dataclass(frozen=True)
class Parting:
    """The first value in which the runs differ."""

    time_ns: int
    cube: int
    field: str
    first: float
    second: float


@dataclass
class Comparison:
    """What two runs have in common, and how far they are apart over time."""

    common: int = 0
    equal: int = 0
    only_first: int = 0
    only_second: int = 0
    parting: Parting | None = None
    other_counts_ns: int | None = None
    milestones: dict[float, tuple[int, int]] = field(default_factory=dict)
    times_ns: list[int] = field(default_factory=list)
    largest: list[float] = field(default_factory=list)
    mean: list[float] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Whether every message of both is in the other, equal to the bit."""
        return self.common == self.equal and not self.only_first and not self.only_second


def compare(
    first: BagReader,
    second: BagReader,
    topics: tuple[str | None, str | None] = (None, None),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Comparison:
    """
    Compare the poses of two bags, time by time and cube by cube.

    Distances are those of the centres, m. `topics` are the names in each, None for the obvious
    one. RecordingError when a bag cannot be read or has no poses.
    """
    names = [
        pose_topic(reader, topic) for reader, topic in zip((first, second), topics, strict=True)
    ]
    result = Comparison()
    total = first.topics[names[0]].count or 0
    streams = (poses(first, names[0]), poses(second, names[1]))
    ours, theirs = next(streams[0], None), next(streams[1], None)
    while ours is not None and theirs is not None:
        if ours[0] < theirs[0]:
            result.only_first += 1
            ours = next(streams[0], None)
        elif theirs[0] < ours[0]:
            result.only_second += 1
            theirs = next(streams[1], None)
        else:
            _compare(result, ours[0], ours[1], theirs[1])
            if result.common % 256 == 0:
                progress(result.common, total)
            ours, theirs = next(streams[0], None), next(streams[1], None)
    result.only_first += (ours is not None) + sum(1 for _ in streams[0])
    result.only_second += (theirs is not None) + sum(1 for _ in streams[1])
    progress(result.common, total)
    return result


def poses(reader: BagReader, topic: str) -> Iterator[tuple[int, Floats]]:
    """Yield time (ns) and poses (N, 7) of each message of a topic; RecordingError."""
    for message in reader.messages([topic]):
        try:
            array = read_pose_array(message.data)
        except MessageError as error:
            raise RecordingError(f'{reader.path}: {error}') from None
        yield array.time_ns, np.asarray(array.poses, np.float64)


def _compare(result: Comparison, time_ns: int, ours: Floats, theirs: Floats) -> None:
    result.common += 1
    if len(ours) != len(theirs) and result.other_counts_ns is None:
        result.other_counts_ns = time_ns
    count = min(len(ours), len(theirs))
    a, b = np.ascontiguousarray(ours[:count]), np.ascontiguousarray(theirs[:count])
    bits = a.view(np.uint64) ^ b.view(np.uint64)
    if len(ours) == len(theirs) and not bits.any():
        result.equal += 1
    elif bits.any() and result.parting is None:
        cube, column = (int(place[0]) for place in np.nonzero(bits))
        result.parting = Parting(
            time_ns, cube, POSE_FIELDS[column], float(a[cube, column]), float(b[cube, column])
        )
    if count:
        apart = np.sqrt(np.sum((a[:, :3] - b[:, :3]) ** 2, axis=1))
        far = float(apart.max())
        for milestone in MILESTONES:
            if far > milestone and milestone not in result.milestones:
                result.milestones[milestone] = (time_ns, int(apart.argmax()))
        result.times_ns.append(time_ns)
        result.largest.append(far)
        result.mean.append(float(apart.mean()))
