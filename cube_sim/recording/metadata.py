"""The description of a bag, version 9 of rosbag2's format.

It is written twice: as `metadata.yaml`, and without its wrapper into each MCAP file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cube_sim.recording.definitions import Definition
from cube_sim.recording.topic import Topic

# rosbag2's own starting time of a bag without messages, the latest time that it can hold.
NO_TIME_NS = 2**63 - 1


@dataclass(frozen=True)
class FileInfo:
    """What one file of a bag holds."""

    name: str
    first_ns: int = NO_TIME_NS
    """Earliest log time; NO_TIME_NS without messages."""
    last_ns: int = NO_TIME_NS
    """Latest log time; NO_TIME_NS without messages."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """Messages of each topic, by topic name."""
    payload_bytes: int = 0
    """Sum of the messages' sizes, B."""

    @property
    def messages(self) -> int:
        return sum(self.counts.values())


def bag_information(
    topics: Sequence[tuple[Topic, Definition]],
    files: Sequence[FileInfo],
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """Return the body of `metadata.yaml`, every key in rosbag2's order."""
    counts: Counter[str] = Counter()
    for file in files:
        counts.update(file.counts)
    filled = [file for file in files if file.messages]
    first_ns = min((file.first_ns for file in filled), default=NO_TIME_NS)
    last_ns = max((file.last_ns for file in filled), default=NO_TIME_NS)
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': last_ns - first_ns},
        'starting_time': {'nanoseconds_since_epoch': first_ns},
        'message_count': sum(counts.values()),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': topic.qos_profiles(),
                    'type_description_hash': definition.type_hash,
                },
                'message_count': counts[topic.name],
            }
            for topic, definition in topics
        ],
        # Chunks compress themselves; these two are for rosbag2's compression of whole messages
        # or files, which this writer does not do.
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [
            {
                'path': file.name,
                'starting_time': {'nanoseconds_since_epoch': file.first_ns},
                'duration': {'nanoseconds': file.last_ns - file.first_ns},
                'message_count': file.messages,
            }
            for file in files
        ],
        'custom_data': dict(custom_data) or None,
        'ros_distro': 'jazzy',
    }
