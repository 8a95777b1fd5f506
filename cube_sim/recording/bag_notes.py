"""What a bag says of itself beside its messages: drops, gaps, quality of service."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from cube_sim.recording.bag_directory import load_yaml
from cube_sim.recording.drops import Gap
from cube_sim.recording.mcap_records import DamageError


def read_drops(custom_data: Mapping[str, str]) -> int:
    """Return how many messages the recorder dropped; 0 if it does not say. Raises DamageError."""
    text = custom_data.get('drops', '0')
    if not (text.isascii() and text.isdecimal()):
        raise DamageError(f'it counts {text!r} drops, which is no number')
    return int(text)


def read_gaps(custom_data: Mapping[str, str]) -> list[Gap]:
    """Return when it dropped them; empty if it does not say. Raises DamageError."""
    try:
        return [Gap(*map(int, row)) for row in json.loads(custom_data.get('gaps', '[]'))]
    except (ValueError, TypeError, RecursionError):
        raise DamageError('its list of gaps cannot be read') from None


def rosbag2_description(notes: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """Return the description that rosbag2 and this package put into each file; {} without one."""
    try:
        found = load_yaml(notes.get('rosbag2', {}).get('serialized_metadata', ''))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def texts(custom_data: object) -> dict[str, str]:
    """Return custom data of a description as pairs of texts, empty if they are none."""
    if not isinstance(custom_data, dict):
        return {}
    return {str(key): str(value) for key, value in custom_data.items()}


def read_qos(text: str) -> list[dict[str, Any]]:
    """Return the QoS profiles that a channel carries as YAML; empty if they cannot be read."""
    try:
        found = load_yaml(text)
    except ValueError:
        return []
    if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
        return []
    return found
