"""Bytes of ROS messages read by both of two libraries that others wrote, as plain values."""

from __future__ import annotations

import dataclasses
from importlib import import_module
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)


def decoded(data: bytes, name: str) -> Any:
    """The message `name`, such as geometry_msgs/msg/PoseArray, as rosbags reads it."""
    return STORE.deserialize_cdr(data, name)


def plain(message: Any) -> Any:
    """Dicts, lists and numbers of a message of either library, without constants."""
    if dataclasses.is_dataclass(message):
        names = [field.name for field in dataclasses.fields(message)]
        return {name: plain(getattr(message, name)) for name in names if name[0].islower()}
    if hasattr(message, 'get_fields_and_field_types'):
        return {
            name: plain(getattr(message, name)) for name in message.get_fields_and_field_types()
        }
    if isinstance(message, (str, bool, int, float)):
        return message
    if isinstance(message, (bytes, np.bool_, np.number)):
        return ord(message) if isinstance(message, bytes) else message.item()
    return [plain(item) for item in message]


def read_by_both(data: bytes, name: str) -> Any:
    """
    The content of a message, after what must hold for each has been checked.

    rclpy and rosbags read the same values. Fast DDS writes the same bytes, but for padding, which
    it leaves as it was in memory; rosbags, which pads with zeros as we do, writes the very same.
    """
    package, _, kind = name.split('/')
    from_rclpy = deserialize_message(data, getattr(import_module(f'{package}.msg'), kind))
    from_rosbags = decoded(data, name)
    content = plain(from_rclpy)
    assert plain(from_rosbags) == content
    assert bytes(STORE.serialize_cdr(from_rosbags, name)) == data
    written = serialize_message(from_rclpy)
    # For empty arrays of eight-byte numbers Fast DDS counts padding that it does not write, and
    # sends what lies there: a parameter has two such arrays. In all else the lengths are equal.
    arrays = sum(2 * len(content.get(f'{which}_parameters', [])) for which in ('new', 'changed'))
    assert 0 <= len(written) - len(data) <= 8 * arrays
    differing = [ours for ours, theirs in zip(data, written, strict=False) if ours != theirs]
    assert not any(differing)
    return content
