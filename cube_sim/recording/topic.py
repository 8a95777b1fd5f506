"""What a bag has to know about a topic: its name, type and quality of service."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal, get_args

from cube_sim.recording.errors import RecordingError

Reliability = Literal['reliable', 'best_effort']
Durability = Literal['volatile', 'transient_local']

_NAME = re.compile(r'(/[A-Za-z_]\w*)+', re.ASCII)
_TYPE = re.compile(r'[a-z]\w*/msg/[A-Z]\w*', re.ASCII)


@dataclass(frozen=True)
class Topic:
    """One recorded topic.

    Raises RecordingError if a field is not of the form described here.
    """

    name: str
    """Resolved name: '/cube_sim/poses'."""
    type: str
    """Full type name: 'geometry_msgs/msg/PoseArray'."""
    reliability: Reliability = 'reliable'
    durability: Durability = 'volatile'
    depth: int = 10
    """Messages kept by the publisher, at least 1."""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise RecordingError(
                f'{self.name!r} is not a resolved topic name; write it like /cube_sim/poses.'
            )
        check_type_name(self.type)
        for field, choices in (('reliability', Reliability), ('durability', Durability)):
            if getattr(self, field) not in get_args(choices):
                raise RecordingError(
                    f'{self.name}: {field} {getattr(self, field)!r} is unknown; '
                    f'choose one of {", ".join(get_args(choices))}.'
                )
        if self.depth < 1:
            raise RecordingError(f'{self.name}: depth {self.depth} must be at least 1.')

    def qos_profiles(self) -> list[dict[str, Any]]:
        """Return the offered QoS profiles as rosbag2 metadata version 9 words them."""
        return [
            {
                'history': 'keep_last',
                'depth': self.depth,
                'reliability': self.reliability,
                'durability': self.durability,
                'deadline': _infinite(),
                'lifespan': _infinite(),
                'liveliness': 'automatic',
                'liveliness_lease_duration': _infinite(),
                'avoid_ros_namespace_conventions': False,
            }
        ]

    def qos_yaml(self) -> str:
        """Return the same profiles as the YAML list that an MCAP channel carries."""
        return to_yaml(self.qos_profiles())


def check_type_name(name: str) -> None:
    """Raise RecordingError unless `name` is a full message type name."""
    if not _TYPE.fullmatch(name):
        raise RecordingError(
            f'{name!r} is not a message type; write it like geometry_msgs/msg/PoseArray.'
        )


def to_yaml(value: object) -> str:
    """Return `value` as block-style YAML, keys in their given order."""
    # Imported here: it is a third of this package's import time, and needed only for a bag.
    import yaml  # type: ignore[import-untyped,unused-ignore]

    text: str = yaml.safe_dump(value, sort_keys=False, default_flow_style=False, width=1000)
    return text


def _infinite() -> dict[str, int]:
    # A new dict each time: PyYAML writes a shared one as an alias, which few readers expect here.
    # The value is what DDS calls infinite, 2^63 - 1 ns.
    return {'sec': 9223372036, 'nsec': 854775807}
