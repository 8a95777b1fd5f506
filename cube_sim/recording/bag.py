"""A bag: a directory with one or more MCAP files and `metadata.yaml`."""

from __future__ import annotations

import builtins
import contextlib
import errno
import os
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from cube_sim import __version__
from cube_sim.recording.definitions import find_definition
from cube_sim.recording.errors import RecordingError, reason
from cube_sim.recording.mcap_file import Compression, McapFile, Notes
from cube_sim.recording.metadata import FileInfo, bag_information
from cube_sim.recording.topic import Topic, to_yaml

CHUNK_SIZE = 1024 * 1024
_LATEST_NS = 2**63 - 1
# Errors that removing something can cure.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# Given back on a full disk beyond what the MCAP index takes: room for metadata.yaml, whose size is
# some 600 bytes per topic, and for the file system's rounding to blocks.
_SPARE_BYTES = 64 * 1024


class BagWriter:
    """Writes a bag. The same calls make the same bytes: no clock is read.

    Once something could not be written, all further writes are refused, and `close` makes a whole
    bag of what was flushed before.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic],
        *,
        compression: Compression = 'none',
        chunk_size: int = CHUNK_SIZE,
    ) -> None:
        """Create the directory `path` (and those above it) and the first file in it.

        chunk_size: B of messages, above which a chunk ends.
        Raises RecordingError if `path` exists, cannot be written, or a definition is missing.
        """
        if chunk_size < 1:
            raise RecordingError(f'A chunk size of {chunk_size} bytes must be at least 1.')
        if len({topic.name for topic in topics}) < len(topics):
            raise RecordingError('Two topics of a bag have the same name; name each only once.')
        self.path = path
        self.error: str | None = None
        self.lost = 0
        """Messages that were taken by `write` and are not in the bag."""
        self._topics = [(topic, find_definition(topic.type)) for topic in topics]
        self._names = frozenset(topic.name for topic in topics)
        self._compression = compression
        self._chunk_size = chunk_size
        self._taken = 0
        self._closed = False
        # Files before the current one: none, as long as a bag is not split.
        self._finished: list[FileInfo] = []
        _make_directory(path)
        self._file = self._open_file(0)

    @property
    def messages(self) -> int:
        """Messages in the bag."""
        return self._file.messages

    @property
    def bytes(self) -> int:
        """Sum of the messages' sizes, B, without MCAP overhead and before compression."""
        return self._file.payload_bytes

    def check(self, topic_name: str, log_time_ns: int) -> None:
        """Raise RecordingError unless a message of this topic and time can be in the bag."""
        if topic_name not in self._names:
            raise RecordingError(
                f'{topic_name} is not a topic of {self.path}; '
                f'it has {", ".join(sorted(self._names)) or "none"}.'
            )
        if not 0 <= log_time_ns <= _LATEST_NS:
            raise RecordingError(
                f'{topic_name}: a log time of {log_time_ns} ns must lie in 0 to 2^63 - 1.'
            )

    def write(self, topic_name: str, log_time_ns: int, data: builtins.bytes) -> None:
        """Add one serialised message; its publish time is its log time, ns.

        Raises RecordingError, also for the messages before that were not flushed yet.
        """
        self.check(topic_name, log_time_ns)
        self._check_open()
        self._taken += 1
        try:
            self._file.write(topic_name, log_time_ns, data)
        except OSError as error:
            raise self._stopped_by(error) from error

    def flush(self) -> None:
        """Hand what was written to the operating system, as a chunk that readers can read.

        Raises RecordingError.
        """
        self._check_open()
        try:
            self._file.flush()
        except OSError as error:
            raise self._stopped_by(error) from error

    def close(self, drops: int = 0) -> Path:
        """Finish the file and write `metadata.yaml`; return the bag's path. May be repeated.

        drops: messages that never came here; with those lost here they are noted in the bag.
        Raises RecordingError if the bag could not be made whole.
        """
        if self._closed:
            return self.path
        self._closed = True
        try:
            self._finish(drops)
        except OSError as error:
            raise RecordingError(
                f'{self.path} could not be finished ({reason(error)}); '
                'what was flushed is there, and cube_bag recover makes a whole bag of it.'
            ) from error
        finally:
            self._file.close()
        return self.path

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _open_file(self, number: int) -> McapFile:
        path = self.path / f'{self.path.name}_{number}.mcap'
        try:
            return McapFile(
                path,
                self._topics,
                _rosbag2_note(self._information([FileInfo(path.name)], {})),
                library=f'cube_sim {__version__}',
                compression=self._compression,
                chunk_size=self._chunk_size,
            )
        except (OSError, RecordingError) as error:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
                if not self._finished:
                    self.path.rmdir()
            if isinstance(error, RecordingError):
                raise
            raise _not_writable(path, error) from error

    def _information(self, files: list[FileInfo], custom_data: dict[str, str]) -> dict[str, Any]:
        return bag_information(self._topics, [*self._finished, *files], custom_data)

    def _check_open(self) -> None:
        if self._closed:
            raise RecordingError(f'{self.path} is closed; open a new bag.')
        if self.error is not None:
            raise RecordingError(self.error)

    def _stopped_by(self, error: OSError) -> RecordingError:
        self.lost = self._taken - self._file.messages
        self.error = (
            f'Recording to {self.path} stopped ({reason(error)}); the bag ends with what was '
            'flushed before. Make room, or choose another disk, and start a new one.'
        )
        return RecordingError(self.error)

    def _finish(self, drops: int) -> None:
        """Finish file and metadata.yaml; if there is no room, give up the last chunks for them."""
        try:
            self._finish_once(drops)
        except OSError as error:
            self._stopped_by(error)
            if error.errno not in _NO_ROOM:
                raise
            # Bounded on purpose: if this much room does not help, no more messages are spent.
            room = 2 * self._file.tail_bytes(self._notes(drops)[0]) + _SPARE_BYTES
            self._file.cut_back(room)
            self.lost = self._taken - self._file.messages
            self._finish_once(drops)

    def _finish_once(self, drops: int) -> None:
        self._file.flush()
        notes, information = self._notes(drops)
        self._file.finish(notes)
        path = self.path / 'metadata.yaml'
        unfinished = self.path / 'metadata.yaml.part'
        try:
            text = to_yaml({'rosbag2_bagfile_information': information})
            unfinished.write_bytes(text.encode())
            unfinished.replace(path)
        except OSError:
            unfinished.unlink(missing_ok=True)
            raise

    def _notes(self, drops: int) -> tuple[Notes, dict[str, Any]]:
        custom_data = {'drops': str(drops + self.lost)}
        if self.error is not None:
            custom_data['error'] = self.error
        information = self._information([self._file.info()], custom_data)
        return {**_rosbag2_note(information), 'cube_sim': custom_data}, information


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


def _rosbag2_note(information: dict[str, Any]) -> Notes:
    return {'rosbag2': {'serialized_metadata': to_yaml(information)}}


def _make_directory(path: Path) -> None:
    try:
        path.mkdir(parents=True)
    except FileExistsError:
        raise RecordingError(f'{path} exists already, not overwriting.') from None
    except (OSError, ValueError) as error:
        raise _not_writable(path, error) from error


def _not_writable(path: Path, error: Exception) -> RecordingError:
    return RecordingError(
        f'{path} cannot be created ({reason(error)}); '
        'choose a bag directory that this user can write to, on a disk with room.'
    )
