"""The proof that a recording is what the simulator computes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.replay import Replay
from cube_sim.analysis.timeline import Posed, RunTopics, timeline
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader, Gap

Floats = NDArray[np.float64]

# The columns of a pose.
POSE_FIELDS = (
    'position.x',
    'position.y',
    'position.z',
    'orientation.x',
    'orientation.y',
    'orientation.z',
    'orientation.w',
)


@dataclass(frozen=True)
class Difference:
    """The first value that was recorded otherwise than it is simulated."""

    time_ns: int
    cube: int
    field: str
    recorded: float
    simulated: float


@dataclass
class Verification:
    """What was compared, and what differs."""

    messages: int = 0
    poses: int = 0
    differing_bits: int = 0
    differing_messages: int = 0
    first: Difference | None = None
    unverifiable: str | None = None
    gaps: list[Gap] = field(default_factory=list)
    drops: int = 0

    @property
    def verified(self) -> bool:
        """Whether everything could be compared and nothing differs."""
        return self.messages > 0 and self.first is None and self.unverifiable is None


def verify(
    reader: BagReader, progress: Callable[[int, int], None] = lambda done, total: None
) -> Verification:
    """
    Simulate the run of the bag again and compare every pose bit by bit.

    Messages that the recorder dropped are named and not missed, as long as no throw, setting or
    reset was among them; from there on nothing can be verified, and that is said.
    `progress` gets messages done and in all. RecordingError when the bag cannot be read.
    """
    topics = RunTopics.of(reader)
    result = Verification(gaps=list(reader.gaps), drops=reader.drops)
    replay = Replay()
    total = reader.topics[topics.poses].count or 0
    for moment in timeline(reader, topics):
        try:
            replay.take(moment)
        except RecordingError as error:
            if not reader.drops:
                raise
            result.unverifiable = str(error)
            return result
        if isinstance(moment, Posed):
            if len(moment.poses) != len(replay.world):
                result.unverifiable = (
                    f'At {moment.time_ns / 1e9:.3f} s {len(moment.poses)} poses are recorded and '
                    f'{len(replay.world)} cubes simulated: throws or a reset were not recorded.'
                )
                return result
            _compare(result, moment, replay.world.poses)
            if result.messages % 256 == 0:
                progress(result.messages, total)
    progress(result.messages, total)
    return result


def _compare(result: Verification, moment: Posed, simulated: Floats) -> None:
    result.messages += 1
    result.poses += len(simulated)
    recorded = np.ascontiguousarray(moment.poses, np.float64)
    ours = np.ascontiguousarray(simulated, np.float64)
    bits = recorded.view(np.uint64) ^ ours.view(np.uint64)
    if not bits.any():
        return
    result.differing_messages += 1
    result.differing_bits += int(np.unpackbits(bits.view(np.uint8)).sum())
    if result.first is None:
        cube, column = (int(place[0]) for place in np.nonzero(bits))
        result.first = Difference(
            moment.time_ns,
            cube,
            POSE_FIELDS[column],
            float(recorded[cube, column]),
            float(ours[cube, column]),
        )
