"""The run that a bag holds, as moments in the order in which they happened."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.decode import (
    MessageError,
    read_header,
    read_odometry,
    read_parameter_event,
    read_pose_array,
)
from cube_sim.physics import PhysicsError, Settings
from cube_sim.physics.world import turned_by
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader, RecordedMessage
from cube_sim.simulation.parameters import PHYSICS, settings_with

Floats = NDArray[np.float64]

_POSE_ARRAY = 'geometry_msgs/msg/PoseArray'


@dataclass(frozen=True)
class Configured:
    """Settings that hold for the steps from `time_ns` on."""

    time_ns: int
    settings: Settings


@dataclass(frozen=True)
class Thrown:
    """A cube that is there from `time_ns` on: pose (7,) and velocity (6,), world, m and rad."""

    time_ns: int
    index: int
    pose: Floats
    velocity: Floats


@dataclass(frozen=True)
class Removed:
    """The reset that took all cubes at `time_ns`."""

    time_ns: int


@dataclass(frozen=True)
class Posed:
    """A message of poses (N, 7): the state after the step that ends at `time_ns`."""

    time_ns: int
    poses: Floats


Moment = Configured | Thrown | Removed | Posed


@dataclass(frozen=True)
class RunTopics:
    """The topics of a run in a bag, by their resolved names."""

    poses: str
    throws: str
    settings: str
    resets: str

    @classmethod
    def of(cls, reader: BagReader) -> RunTopics:
        """Return those of the one simulation in the bag; RecordingError when there is none."""
        bases = [
            name.removesuffix('/throws')
            for name, topic in reader.topics.items()
            if name.endswith('/throws') and topic.type == 'nav_msgs/msg/Odometry'
        ]
        for base in bases:
            topics = cls(*(f'{base}/{name}' for name in ('poses', 'throws', 'settings', 'resets')))
            if topics.settings in reader.topics and topics.poses in reader.topics:
                return topics
        raise RecordingError(
            f'{reader.path} holds no run of cube_sim: it has no throws and settings to simulate '
            'again from, only bags that sim_node recorded do.'
        )


def timeline(reader: BagReader, topics: RunTopics) -> Iterator[Moment]:
    """Yield the moments of the run; RecordingError when a message is not what it should be."""
    settings = Settings()
    wanted = (topics.poses, topics.throws, topics.settings, topics.resets)
    for message in reader.messages([name for name in wanted if name in reader.topics]):
        try:
            if message.topic == topics.poses:
                array = read_pose_array(message.data)
                yield Posed(array.time_ns, array.poses)
            elif message.topic == topics.throws:
                yield _thrown(message)
            elif message.topic == topics.settings:
                event = read_parameter_event(message.data)
                settings = _settings(settings, {**event.new, **event.changed})
                yield Configured(event.time_ns, settings)
            else:
                yield Removed(read_header(message.data)[0])
        except (MessageError, PhysicsError, KeyError, ValueError) as error:
            raise RecordingError(
                f'{reader.path}: a message of {message.topic} at {message.time_ns / 1e9:.3f} s '
                f'is not what sim_node sends: {error}'
            ) from None


def pose_topic(reader: BagReader, name: str | None = None) -> str:
    """
    Return the topic of poses to look at: `name`, or the only one (of cube_sim first).

    RecordingError lists what there is when that leaves a doubt.
    """
    arrays = [topic for topic in reader.topics.values() if topic.type == _POSE_ARRAY]
    if name is not None:
        found = reader.topics.get(name)
        if found is None or found.type != _POSE_ARRAY:
            has = f'is of type {found.type}' if found else 'is not in the bag'
            known = ', '.join(topic.name for topic in arrays) or 'there are none'
            raise RecordingError(
                f'{reader.path}: {name} {has}; topics of type {_POSE_ARRAY}: {known}.'
            )
        return name
    own = [topic for topic in arrays if topic.name.endswith('/poses')]
    for candidates in (own, arrays):
        if len(candidates) == 1:
            return candidates[0].name
    if not arrays:
        raise RecordingError(f'{reader.path} has no topic of type {_POSE_ARRAY} to look at.')
    raise RecordingError(
        f'{reader.path} has several topics of poses; choose one with --topic: '
        f'{", ".join(topic.name for topic in arrays)}.'
    )


def _thrown(message: RecordedMessage) -> Thrown:
    throw = read_odometry(message.data)
    orientation = throw.pose[3:]
    velocity = np.concatenate(
        [turned_by(orientation, throw.twist[:3]), turned_by(orientation, throw.twist[3:])]
    )
    index = int(throw.child_frame_id.removeprefix('cube_'))
    return Thrown(throw.time_ns, index, np.array(throw.pose), velocity)


def _settings(before: Settings, values: dict[str, Any]) -> Settings:
    return settings_with(before, {name: values[name] for name in values if name in PHYSICS})
