"""A bag: a directory with one or more MCAP files and `metadata.yaml`."""

from __future__ import annotations

import builtins
import contextlib
import errno
import json
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from cube_sim import __version__
from cube_sim.recording.compression import Compression
from cube_sim.recording.definitions import find_definition
from cube_sim.recording.directory import make_directory, not_writable, write_metadata
from cube_sim.recording.drops import DropLog
from cube_sim.recording.errors import RecordingError, reason
from cube_sim.recording.mcap_file import McapFile, Notes
from cube_sim.recording.metadata import FileInfo, bag_information
from cube_sim.recording.topic import Topic, to_yaml

CHUNK_SIZE = 1024 * 1024
_LATEST_NS = 2**63 - 1
# Errors that removing something can cure.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# Given back on a full disk beyond what the MCAP index takes: room for metadata.yaml, whose size is
# some 600 bytes per topic, and for the file system's rounding to blocks.
_SPARE_BYTES = 64 * 1024
# A disk that was full must have room for this many chunks before writing goes on; with less the
# next error would come at once.
_ROOM_CHUNKS = 4


class BagWriter:
    """Writes a bag, as one file or several. The same calls make the same bytes: no clock is read.

    Once something could not be written, all further writes are refused until `resume` has begun
    a new file. What was flushed before stays as it is, what was not waits in memory, and `close`
    makes a whole bag of what there is.

    The metadata record `cube_sim` of each file, and `custom_data` in metadata.yaml, say what the
    bag lacks: the notes of DropLog, and if it applies `error` (why the recording ended early),
    `resumed` (how often it went on after an error) and `gone` (JSON list of files that were
    removed while it went on). A file may hold several such records: the last one counts.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic],
        *,
        compression: Compression = 'none',
        chunk_size: int = CHUNK_SIZE,
        max_bytes: int = 0,
        max_duration_ns: int = 0,
    ) -> None:
        """Create the directory `path` (and those above it) and the first file in it.

        chunk_size: B of messages, above which a chunk ends.
        max_bytes: B above which no file grows, unless a single message is larger; 0 is no limit.
        max_duration_ns: ns of log time after which the next file begins; 0 is no limit.
        Raises RecordingError if `path` exists, cannot be written, or a definition is missing.
        """
        if chunk_size < 1:
            raise RecordingError(f'A chunk size of {chunk_size} bytes must be at least 1.')
        if max_bytes < 0 or max_duration_ns < 0:
            raise RecordingError('A limit of a file must be positive, or 0 for none.')
        if len({topic.name for topic in topics}) < len(topics):
            raise RecordingError('Two topics of a bag have the same name; name each only once.')
        self.path = path
        self.error: str | None = None
        """Why writes are refused; None if they are not."""
        self.resumed = 0
        """How often writing went on after an error."""
        self.drops = DropLog()
        """What is not in the bag; whoever drops messages before they come here adds them."""
        self._topics = [(topic, find_definition(topic.type)) for topic in topics]
        self._names = frozenset(topic.name for topic in topics)
        self._compression = compression
        self._chunk_size = chunk_size
        self._max_bytes = max_bytes
        self._max_duration_ns = max_duration_ns
        self._taken = 0
        self._noted = 0  # drops that the current file knows of
        self._closed = False
        self._finished: list[FileInfo] = []  # the files before the current one
        self._gone: list[str] = []
        self._number = 0
        # Prepared first: the directory is not without its file for longer than need be.
        self._file = self._new_file()
        make_directory(path)
        try:
            self._file.create()
        except OSError as error:
            with contextlib.suppress(OSError):
                path.rmdir()
            raise not_writable(self._file.path, error) from error

    @property
    def messages(self) -> int:
        """Messages in the bag, those included that wait in memory."""
        return self._file.messages + sum(file.messages for file in self._finished)

    @property
    def bytes(self) -> int:
        """Sum of the messages' sizes, B, without MCAP overhead and before compression."""
        return self._file.payload_bytes + sum(file.payload_bytes for file in self._finished)

    @property
    def lost(self) -> int:
        """Messages that were taken by `write` and are not in the bag."""
        return self._taken - self.messages

    @property
    def files(self) -> int:
        """Files of the bag, the current one included."""
        return len(self._finished) + 1

    @property
    def file_path(self) -> Path:
        """The current file."""
        return self._file.path

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

        Raises RecordingError if something could not be written; this message was taken then, and
        waits with the others that are not yet on disk.
        """
        self.check(topic_name, log_time_ns)
        self._check_open()
        self._taken += 1
        try:
            if self._is_full_before(log_time_ns, len(data)):
                self._split()
        except OSError as error:
            self._file.add(topic_name, log_time_ns, data)
            raise self._stopped_by(error) from error
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
            if self._noted != self.drops.total:
                self._noted = self.drops.total
                self._file.note({'cube_sim': self._custom_data()})
        except OSError as error:
            raise self._stopped_by(error) from error

    def resume(self) -> None:
        """After an error: go on in a new file, which begins with what waits in memory.

        If the bag's directory has gone, a new one is made, and what is gone with the old one
        counts as dropped. Raises RecordingError if nothing can be written yet.
        """
        if self.error is None:
            return
        try:
            kept = self._finish_or_miss()
            self._change_file(reserve=_ROOM_CHUNKS * self._chunk_size, keep=kept)
        except OSError as error:
            raise RecordingError(f'{self.path} cannot be written ({reason(error)}).') from error
        self.error = None
        self.resumed += 1

    def close(self, drops: int = 0) -> Path:
        """Finish the file and write `metadata.yaml`; return the bag's path. May be repeated.

        drops: messages that never came here and are not in `self.drops`.
        Raises RecordingError if the bag could not be made whole.
        """
        if self._closed:
            return self.path
        self._closed = True
        self.drops.add_undated(drops)
        try:
            self._finish()
        except OSError as error:
            self._drop(self._file.discard())
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

    def _new_file(self) -> McapFile:
        """Return the file of the present number, not yet created."""
        path = self.path / f'{self.path.name}_{self._number}.mcap'
        return McapFile(
            path,
            self._topics,
            _rosbag2_note(self._information([FileInfo(path.name)], {})),
            library=f'cube_sim {__version__}',
            compression=self._compression,
            chunk_size=self._chunk_size,
        )

    def _is_full_before(self, log_time_ns: int, size: int) -> bool:
        """Say whether a message of that time and size, B, belongs to the next file."""
        first_ns = self._file.first_ns
        if first_ns is None:
            return False
        if self._max_bytes and self._file.size + size > self._max_bytes:
            return True
        return bool(self._max_duration_ns) and log_time_ns - first_ns >= self._max_duration_ns

    def _split(self) -> None:
        """Finish the file and begin the next. Raises OSError; the file is the same then."""
        self._file.flush()
        self._file.finish(self._notes()[0])
        self._change_file()

    def _finish_or_miss(self) -> bool:
        """Make a whole file of the current one; False if it is not there. Raises OSError."""
        missing = self._file.reopen()
        if missing is None:
            # Whoever moved it away gets a whole file.
            with contextlib.suppress(OSError):
                self._file.finish(self._notes()[0])
            return False
        self._drop(missing)
        try:
            self._file.finish(self._notes()[0])
        except OSError as error:
            if error.errno != errno.EFBIG:
                raise
            # No file may be as large: waiting will not change it.
            self._drop(self._file.cut_back(self._file.tail_bytes(self._notes()[0])))
            self._file.finish(self._notes()[0])
        return True

    def _change_file(self, reserve: int = 0, keep: bool = True) -> None:
        """Begin the next file with what the current one could not take, and close that.

        reserve: B that the disk must have beyond that. keep: count the current one as a part of
        the bag. Raises OSError; the file is the same then, and there is no next one.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        done = self._file.info()
        self._number += 1
        try:
            file = self._new_file()
            file.create()
            try:
                file.reserve(reserve)
                file.take_over(self._file)
            except OSError:
                file.close()
                with contextlib.suppress(OSError):
                    file.path.unlink()
                raise
        except OSError:
            self._number -= 1
            raise
        self._file.close()
        self._file = file
        self._noted = 0
        self._finished.append(done)
        self._miss_files([] if keep else [done.name])

    def _miss_files(self, names: list[str]) -> None:
        """Give up finished files of these names, and those that are no longer there."""
        for file in list(self._finished):
            if file.name in names or _is_missing(self.path / file.name):
                self._finished.remove(file)
                self._gone.append(file.name)
                self._drop(file)

    def _drop(self, messages: FileInfo) -> None:
        self.drops.add(messages.first_ns, messages.last_ns, messages.counts)

    def _information(self, files: list[FileInfo], custom_data: dict[str, str]) -> dict[str, Any]:
        return bag_information(self._topics, [*self._finished, *files], custom_data)

    def _check_open(self) -> None:
        if self._closed:
            raise RecordingError(f'{self.path} is closed; open a new bag.')
        if self.error is not None:
            raise RecordingError(self.error)

    def _stopped_by(self, error: OSError) -> RecordingError:
        if isinstance(error, (FileNotFoundError, NotADirectoryError)):
            self.error = (
                f'Recording to {self.path} stopped: {self._file.path.name} is no longer there. '
                'Leave a bag where it is until its recording has ended.'
            )
        else:
            self.error = (
                f'Recording to {self.path} stopped ({reason(error)}); what was flushed before '
                'is safe. Make room, or mend the disk.'
            )
        return RecordingError(self.error)

    def _make_room(self) -> None:
        """Give up the last chunks for index and metadata. Raises OSError.

        Bounded on purpose: if this much room does not help, no more messages are spent.
        """
        room = 2 * self._file.tail_bytes(self._notes()[0]) + _SPARE_BYTES
        self._drop(self._file.cut_back(room))

    def _finish(self) -> None:
        """Finish file and metadata.yaml. Raises OSError.

        Without room for that, what waits for the disk is given up, or else the last chunks.
        """
        self._miss_files([])
        try:
            self._finish_once()
        except OSError as error:
            self._stopped_by(error)
            if error.errno not in _NO_ROOM:
                raise
        else:
            return
        waiting = self._file.discard()
        self._drop(waiting)
        if waiting.messages:
            with contextlib.suppress(OSError):
                self._finish_once()
                return
        self._make_room()
        self._finish_once()

    def _finish_once(self) -> None:
        self._file.flush()
        notes, information = self._notes()
        self._file.finish(notes)
        write_metadata(self.path, information)

    def _custom_data(self) -> dict[str, str]:
        custom_data = self.drops.notes()
        if self.error is not None:
            custom_data['error'] = self.error
        if self.resumed:
            custom_data['resumed'] = str(self.resumed)
        if self._gone:
            custom_data['gone'] = json.dumps(self._gone)
        return custom_data

    def _notes(self) -> tuple[Notes, dict[str, Any]]:
        custom_data = self._custom_data()
        information = self._information([self._file.info()], custom_data)
        return {**_rosbag2_note(information), 'cube_sim': custom_data}, information


def _is_missing(path: Path) -> bool:
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:
        return False  # nobody knows
    return False


def _rosbag2_note(information: dict[str, Any]) -> Notes:
    return {'rosbag2': {'serialized_metadata': to_yaml(information)}}
