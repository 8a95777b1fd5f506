"""The motion in a bag as a stream of states: the recorded poses, with their velocities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.energy import gravity_of
from cube_sim.analysis.findings import REPLAY, Findings
from cube_sim.analysis.replay import Replay
from cube_sim.analysis.run import frames, run_topics
from cube_sim.analysis.sampling import DIFFERENCE, FLIGHT, UNKNOWN, samples
from cube_sim.analysis.timeline import Posed, Removed, RunTopics, pose_topic, timeline
from cube_sim.recording.reader import BagReader

Floats = NDArray[np.float64]

# What to call the sources of velocities; the codes of `sampling`, and one more.
REPLAYED = 3
SOURCES = {UNKNOWN: 'unknown', FLIGHT: 'flight', DIFFERENCE: 'difference', REPLAYED: 'replay'}


class States(NamedTuple):
    """The cubes at one time: poses (N, 7), velocities (N, 6) (nan if unknown), sources (N,)."""

    time_ns: int
    generation: int
    poses: Floats
    velocities: Floats
    source: NDArray[np.uint8]


def states(
    reader: BagReader, found: Findings, *, topic: str | None = None, noise: float = 0.0
) -> Iterator[States]:
    """
    Yield the states of every recorded message, by the method that `found` says is possible.

    `topic` and `noise` as in `run.find_out`; RecordingError when the bag cannot be read.
    """
    if found.method == REPLAY:
        yield from _replayed(reader)
        return
    topics = run_topics(reader)
    name = pose_topic(reader, topic if topic is not None or topics is None else topics.poses)
    for sample in samples(frames(reader, name), gravity_of(found.settings[0]), noise):
        yield States(
            sample.time_ns, sample.generation, sample.poses, sample.velocities, sample.source
        )


def _replayed(reader: BagReader) -> Iterator[States]:
    replay = Replay()
    generation = 0
    for moment in timeline(reader, RunTopics.of(reader)):
        replay.take(moment)
        if isinstance(moment, Removed):
            generation += 1
        elif isinstance(moment, Posed):
            source = np.full(len(moment.poses), REPLAYED, np.uint8)
            yield States(moment.time_ns, generation, moment.poses, replay.world.velocities, source)
