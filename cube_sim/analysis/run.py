"""A bag, looked into by the best way that it allows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.estimation import estimate
from cube_sim.analysis.findings import Findings
from cube_sim.analysis.observation import NotAsRecordedError, observe
from cube_sim.analysis.timeline import Configured, RunTopics, pose_topic, timeline
from cube_sim.messages.decode import MessageError, PoseArrayDecoder
from cube_sim.physics import PhysicsError, Settings
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

Floats = NDArray[np.float64]
Progress = Callable[[int, int], None]


def find_out(
    reader: BagReader,
    *,
    topic: str | None = None,
    from_poses: bool = False,
    cube_size: float | None = None,
    gravity: float | None = None,
    noise: float = 0.0,
    progress: Progress = lambda done, total: None,
) -> Findings:
    """
    Return what the run of the bag does.

    A run of cube_sim is simulated again, unless `from_poses`, another `topic`, or a recording
    that the simulation does not reproduce leave only the poses; a note then says which. For
    those, `cube_size` (m) and `gravity` (m/s^2) go before what the bag says of its settings.
    RecordingError when the bag cannot be read, or holds no poses.
    """
    topics = run_topics(reader)
    notes = []
    if topics is not None and not from_poses and topic in (None, topics.poses):
        try:
            return observe(reader, progress)
        except NotAsRecordedError as error:
            notes.append(f'From the poses alone: {error}.')
        except RecordingError as error:
            # A throw that the recorder dropped; a bag that cannot be read fails again below.
            notes.append(f'From the poses alone: {error}')
    name = pose_topic(reader, topic if topic is not None or topics is None else topics.poses)
    known = recorded_settings(reader)
    settings, assumed = _settings(known, cube_size, gravity)
    notes += assumed
    total = reader.topics[name].count or 0
    found = estimate(
        frames(reader, name),
        settings,
        known=bool(known),
        noise=noise,
        progress=lambda done: progress(done, total),
    )
    progress(total, total)
    found.notes = notes + found.notes
    return found


def run_topics(reader: BagReader) -> RunTopics | None:
    """Return the topics of the run of cube_sim in the bag, or None if there is none."""
    try:
        return RunTopics.of(reader)
    except RecordingError:
        return None


def recorded_settings(reader: BagReader) -> list[tuple[int, Settings]]:
    """
    Return the settings of the run, each different from the last, with their times in ns.

    Of those that came at one time the last holds: a scenario may set what the start did not.
    """
    topics = run_topics(reader)
    if topics is None:
        return []
    changes: list[tuple[int, Settings]] = []
    for moment in timeline(reader, RunTopics('', '', topics.settings, '')):
        if isinstance(moment, Configured):
            if changes and changes[-1][0] == moment.time_ns:
                changes.pop()
            if not changes or changes[-1][1] != moment.settings:
                changes.append((moment.time_ns, moment.settings))
    return changes


def frames(reader: BagReader, topic: str) -> Iterator[tuple[int, Floats]]:
    """Yield time (ns) and poses (N, 7) of each message of a topic; RecordingError."""
    decode = PoseArrayDecoder()
    for message in reader.messages([topic]):
        try:
            array = decode(message.data)
        except MessageError as error:
            raise RecordingError(f'{reader.path}: {error}') from None
        # A publisher that leaves the stamp empty has been recorded at some time nevertheless.
        yield array.time_ns or message.time_ns, array.poses


def _settings(
    known: list[tuple[int, Settings]], cube_size: float | None, gravity: float | None
) -> tuple[list[tuple[int, Settings]], list[str]]:
    """Return the settings to go by, and in words what had to be assumed."""
    given = {'cube_size': cube_size, 'gravity': gravity}
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    try:
        settings = [
            (time_ns, record.changed(**changes)) for time_ns, record in known or [(0, Settings())]
        ]
    except PhysicsError as error:
        raise RecordingError(str(error)) from None
    first = settings[0][1]
    words = []
    if not known:
        guessed = [
            f'{words} (--{name.replace("_", "-")})'
            for name, words in (
                ('cube_size', f'a cube size of {first.cube_size:g} m'),
                ('gravity', f'a gravity of {first.gravity:g} m/s^2'),
            )
            if name not in changes
        ]
        if guessed:
            words.append(f'The bag does not say its settings; assumed: {", ".join(guessed)}.')
    fixed = ('cube_size', 'gravity', 'gravity_direction')
    if any(
        getattr(record, name) != getattr(first, name) for _, record in settings for name in fixed
    ):
        words.append(
            'Cube size or gravity changed during the run; estimates take the first throughout.'
        )
    return settings, words
