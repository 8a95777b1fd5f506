"""The directory of a bag, and its `metadata.yaml`."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Any

from cube_sim.recording.errors import RecordingError, reason
from cube_sim.recording.topic import to_yaml


def new_bag_path(directory: Path, wall_time: datetime, stem: str = 'cube_sim') -> Path:
    """Return a free path `<stem>_<YYYY_mm_dd-HH_MM_SS>` in `directory`, with _1, _2 … if taken.

    wall_time: the moment for the name, in the zone that the name shall show.
    """
    name = f'{stem}_{wall_time:%Y_%m_%d-%H_%M_%S}'
    path = directory / name
    number = 0
    while os.path.lexists(path):
        number += 1
        path = directory / f'{name}_{number}'
    return path


def make_directory(path: Path) -> None:
    """Create the directory, and those above it. Raises RecordingError."""
    try:
        path.mkdir(parents=True)
    except FileExistsError:
        raise RecordingError(f'{path} exists already, not overwriting.') from None
    except (OSError, ValueError) as error:
        raise not_writable(path, error) from error


def not_writable(path: Path, error: Exception) -> RecordingError:
    """Return the error for a path at which nothing can be made."""
    return RecordingError(
        f'{path} cannot be created ({reason(error)}); '
        'choose a bag directory that this user can write to, on a disk with room.'
    )


def write_metadata(directory: Path, information: dict[str, Any]) -> None:
    """Write `metadata.yaml`, all of it or nothing. Raises OSError."""
    unfinished = directory / 'metadata.yaml.part'
    try:
        text = to_yaml({'rosbag2_bagfile_information': information})
        unfinished.write_bytes(text.encode())
        unfinished.replace(directory / 'metadata.yaml')
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise
