"""Bags as other recorders make them, by the `mcap` package and by hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

Message = tuple[str, int, bytes]
"""Topic, log time, data."""

DEFINITION = 'string data\n'
TYPE = 'std_msgs/msg/String'
QOS = """- history: 1
  depth: 10
  reliability: 1
  durability: 2
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""


def write_mcap(
    path: Path,
    messages: Sequence[Message],
    *,
    compression: CompressionType = CompressionType.NONE,
    chunk_size: int = 400,
    types: dict[str, str] | None = None,
    channels_per_topic: int = 1,
    notes: dict[str, dict[str, str]] | None = None,
    **options: Any,
) -> Path:
    """Write the messages in their order, to the channels of a topic in turn."""
    with path.open('wb') as out:
        writer = Writer(out, chunk_size=chunk_size, compression=compression, **options)
        writer.start('ros2', 'another recorder')
        schemas: dict[str, int] = {}
        channels: dict[tuple[str, int], int] = {}
        for number, (topic, time_ns, data) in enumerate(messages):
            key = topic, number % channels_per_topic
            if key not in channels:
                kind = (types or {}).get(topic, TYPE)
                if kind not in schemas:
                    schemas[kind] = writer.register_schema(kind, 'ros2msg', DEFINITION.encode())
                metadata = {'offered_qos_profiles': QOS}
                channels[key] = writer.register_channel(topic, 'cdr', schemas[kind], metadata)
            writer.add_message(channels[key], time_ns, data, time_ns, number)
        for name, pairs in (notes or {}).items():
            writer.add_metadata(name, pairs)
        writer.finish()
    return path


def write_metadata(
    directory: Path, files: Sequence[str], messages: Sequence[Message], **changes: Any
) -> Path:
    """Write the metadata.yaml of an older rosbag2; return the directory."""
    times = [time_ns for _, time_ns, _ in messages] or [0]
    body = {
        'version': 5,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': max(times) - min(times)},
        'starting_time': {'nanoseconds_since_epoch': min(times)},
        'message_count': len(messages),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic,
                    'type': TYPE,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': QOS,
                },
                'message_count': count,
            }
            for topic, count in Counter(topic for topic, _, _ in messages).items()
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': list(files),
        **changes,
    }
    text = yaml.safe_dump({'rosbag2_bagfile_information': body}, sort_keys=False)
    (directory / 'metadata.yaml').write_text(text)
    return directory
