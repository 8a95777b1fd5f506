"""Message definitions, as the ROS installation holds them.

An MCAP schema carries the text of a message and of all that it is made of; a channel carries the
type's hash. Both are files below `share/<package>/msg/` of a ROS prefix, so none of this needs
ROS to be imported or running.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cube_sim.recording.errors import RecordingError, reason
from cube_sim.recording.topic import check_type_name

_PRIMITIVES = {
    *('bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring'),
    *('int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64'),
}
_SEPARATOR = '=' * 80


@dataclass(frozen=True)
class Definition:
    """One message type, ready for an MCAP schema and channel."""

    type: str
    """Full type name: 'geometry_msgs/msg/PoseArray'."""
    text: str
    """Its `ros2msg` text: the message, then each type it needs, once, depth first."""
    type_hash: str
    """'RIHS01_' and 64 hexadecimal digits."""


def find_definition(type_name: str) -> Definition:
    """Return the definition of `type_name`; read once per process and set of prefixes.

    Raises RecordingError if the message or one that it needs is not installed.
    """
    check_type_name(type_name)
    return _read_definition(type_name, tuple(_prefixes()))


@cache
def _read_definition(type_name: str, prefixes: tuple[Path, ...]) -> Definition:
    texts: dict[str, str] = {}
    _collect(type_name, prefixes, texts)
    parts = [texts.pop(type_name)]
    for name, text in texts.items():
        package, _, message = name.split('/')
        parts.append(f'{_SEPARATOR}\nMSG: {package}/{message}\n{text}')
    return Definition(type_name, '\n'.join(parts), _read_hash(type_name, prefixes))


def _collect(type_name: str, prefixes: tuple[Path, ...], texts: dict[str, str]) -> None:
    """Add the text of `type_name` and, behind it, of each type it needs that is not there yet."""
    text = _read(type_name, '.msg', prefixes)
    texts[type_name] = text
    for needed in _needed_types(type_name, text):
        if needed not in texts:
            _collect(needed, prefixes, texts)


def _needed_types(type_name: str, text: str) -> Iterator[str]:
    """Yield the full names of the messages that `text` has as fields, in order."""
    own_package = type_name.split('/')[0]
    for line in text.splitlines():
        words = line.split('#')[0].split()
        if not words:
            continue
        field_type = words[0].split('[')[0].split('<')[0]
        if field_type in _PRIMITIVES:
            continue
        package, _, message = field_type.rpartition('/')
        yield f'{package.split("/")[0] or own_package}/msg/{message}'


def _read_hash(type_name: str, prefixes: tuple[Path, ...]) -> str:
    text = _read(type_name, '.json', prefixes)
    try:
        hashes = {row['type_name']: row['hash_string'] for row in json.loads(text)['type_hashes']}
        return str(hashes[type_name])
    except (ValueError, KeyError, TypeError):
        package = type_name.split('/')[0]
        raise RecordingError(
            f'The installed description of {type_name} holds no type hash; '
            f'reinstall the ROS package {package}.'
        ) from None


def _read(type_name: str, suffix: str, prefixes: tuple[Path, ...]) -> str:
    package, _, message = type_name.split('/')
    relative = Path('share', package, 'msg', message + suffix)
    for prefix in (*prefixes, *_prefixes_above(package)):
        path = prefix / relative
        try:
            return path.read_text(encoding='utf-8')
        except (FileNotFoundError, NotADirectoryError):
            continue
        except (OSError, UnicodeDecodeError) as error:
            raise RecordingError(
                f'{path} cannot be read ({reason(error)}); reinstall the ROS package {package}.'
            ) from error
    raise RecordingError(
        f'{type_name} has no {relative} in any ROS prefix; install the ROS package {package} '
        f'(ros-jazzy-{package.replace("_", "-")}) or name its prefix in AMENT_PREFIX_PATH.'
    )


def _prefixes() -> Iterator[Path]:
    for entry in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        if entry:
            yield Path(entry)
    yield Path(sys.prefix)


def _prefixes_above(package: str) -> tuple[Path, ...]:
    """Return the directories above the Python package, found without importing it."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return ()
    return tuple(Path(spec.origin).parents)
