"""One MCAP file: messages in, chunks on disk, and an index at the end.

The records are those of the `mcap` package. Their order is kept here and not by its `Writer`,
for two reasons. Schemas and channels stand at the front of the file, outside of any chunk, so a
file that was killed at any moment still says what it is. And the index stays in reach, so a file
whose disk ran full can be cut back to its last complete chunk and still be finished properly.
"""

from __future__ import annotations

import contextlib
import errno
import os
import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from cube_sim.recording.chunk import OpenChunk, WrittenChunk, encode_chunk, encode_record
from cube_sim.recording.compression import Compression, find_compressor
from cube_sim.recording.definitions import Definition
from cube_sim.recording.metadata import FileInfo
from cube_sim.recording.topic import Topic

Notes = Mapping[str, Mapping[str, str]]
"""Metadata records: name to keys and values."""

_MAGIC = b'\x89MCAP0\r\n'
# What a finished file has beyond its head, its chunks and a second copy of the head's records, B:
# for each chunk its entry in the index, for each message 16, and the footer, notes and counts.
_INDEX_BYTES = 256
_FOOT_BYTES = 4096


class McapFile:
    """Writes one MCAP file of profile `ros2`.

    Each write goes to the operating system at once and holds whole chunks: what was flushed
    survives the death of the process (not a power cut: nothing is forced to the disk itself).
    After an OSError the file ends behind its last complete chunk, and what could not be written
    waits for the next `flush`, here or in the file that takes it over.

    messages, payload_bytes: what the file holds, the open chunk included; B without MCAP overhead.
    first_ns: log time of the first message, None without messages.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[tuple[Topic, Definition]],
        notes: Notes,
        *,
        library: str,
        compression: Compression,
        chunk_size: int,
    ) -> None:
        """Prepare the file; `create` makes it.

        chunk_size: B of messages, above which a chunk ends.
        Raises RecordingError if the compression is not known or not installed.
        """
        self.messages = 0
        self.payload_bytes = 0
        self.first_ns: int | None = None
        self._path = path
        self._compression = '' if compression == 'none' else compression
        self._compress = find_compressor(compression)
        self._chunk_size = chunk_size
        self._schemas: list[Schema] = []
        self._channels: dict[str, Channel] = {}
        self._sequences: Counter[int] = Counter()
        self._open_chunk = OpenChunk()
        self._chunks: list[WrittenChunk] = []
        self._metadata: list[MetadataIndex] = []
        self._end = 0  # behind the last complete chunk; what follows may be cut off
        self._register(topics)
        self._head = self._encode_head(library, notes)

    def create(self) -> None:
        """Create the file and write all but messages. Raises OSError and leaves nothing then."""
        # It gets its name once it has a head, so that no file of that name is ever empty.
        unfinished = self._path.with_name(f'{self._path.name}.part')
        if os.path.lexists(self._path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(self._path))
        self._out = unfinished.open('xb', buffering=0)
        try:
            self._append(self._head)
            unfinished.rename(self._path)
        except OSError:
            self.close()
            with contextlib.suppress(OSError):
                unfinished.unlink()
            raise

    @property
    def path(self) -> Path:
        return self._path

    @property
    def size(self) -> int:
        """About what the file takes when it is finished now, B; a chunk counts uncompressed."""
        return (
            self._end
            + self._open_chunk.size
            + 16 * self._open_chunk.messages
            + len(self._head)
            + _INDEX_BYTES * (len(self._chunks) + 1)
            + _FOOT_BYTES
        )

    def add(self, topic_name: str, log_time_ns: int, data: bytes) -> None:
        """Take a message into the open chunk; its publish time is its log time."""
        channel_id = self._channels[topic_name].id
        self._open_chunk.add(channel_id, self._sequences[channel_id], log_time_ns, data)
        self._sequences[channel_id] += 1
        self.messages += 1
        self.payload_bytes += len(data)
        if self.first_ns is None:
            self.first_ns = log_time_ns

    def write(self, topic_name: str, log_time_ns: int, data: bytes) -> None:
        """Add a message, and flush if the chunk is large enough. Raises OSError as `flush` does."""
        self.add(topic_name, log_time_ns, data)
        if self._open_chunk.size > self._chunk_size:
            self.flush()

    def flush(self) -> None:
        """End the chunk and hand it to the operating system.

        Raises OSError if it could not be written, or if the file is no longer where it was; the
        chunk stays open.
        """
        self._path.stat()  # a file that was removed or moved still takes all that is written
        if not self._open_chunk.index:
            return
        parts, written = encode_chunk(
            self._open_chunk, self._end, self._compression, self._compress
        )
        self._append(*parts)
        self._chunks.append(written)
        self._open_chunk = OpenChunk()

    def note(self, notes: Notes) -> None:
        """Write notes between the chunks. Raises OSError."""
        data = bytearray()
        indexes = _add_notes(data, notes, self._end)
        self._append(bytes(data))
        self._metadata += indexes

    def finish(self, notes: Notes) -> None:
        """Write the notes and the index, which make a whole file of what was flushed.

        May be repeated, with more messages before it. Raises OSError; what was flushed stays.
        """
        tail = self._tail(notes)
        self._write(tail)
        self._out.truncate(self._end + len(tail))

    def reopen(self) -> FileInfo | None:
        """Open the file anew by its name; return what it has lost, or None if that is all.

        Raises OSError.
        """
        try:
            out = self._path.open('r+b', buffering=0)
        except (FileNotFoundError, NotADirectoryError):
            return None
        size = os.fstat(out.fileno()).st_size
        if size < len(self._head):
            out.close()
            return None
        self.close()
        self._out = out
        return self._shorten(size)

    def reserve(self, size: int) -> None:
        """Raise OSError if the disk has no room for `size` bytes more. What it takes it returns."""
        try:
            os.posix_fallocate(self._out.fileno(), self._end, size)
        except OSError as error:
            if error.errno not in (errno.EFBIG, errno.EOPNOTSUPP, errno.EINVAL):
                raise
        finally:
            self._out.truncate(self._end)

    def take_over(self, other: McapFile) -> None:
        """Write what `other`, a file of the same topics, could not; count on from its sequences.

        Raises OSError; then `other` is unchanged.
        """
        self._open_chunk = chunk = other._open_chunk
        self._sequences = Counter(other._sequences)
        if chunk.index:
            self.first_ns = chunk.times()[0]
        self.flush()
        self.messages += chunk.messages
        self.payload_bytes += chunk.payload_bytes
        other.discard()

    def discard(self) -> FileInfo:
        """Give up the open chunk; return what was in it."""
        chunk, self._open_chunk = self._open_chunk, OpenChunk()
        self.messages -= chunk.messages
        self.payload_bytes -= chunk.payload_bytes
        if not chunk.index:
            return FileInfo(self._path.name)
        return FileInfo(self._path.name, *chunk.times(), self._by_name(chunk.counts()))

    def cut_back(self, room: int) -> FileInfo:
        """Remove the index, and chunks from the end until at least `room` bytes are free.

        Return what was in these chunks. Raises OSError.
        """
        return self._shorten(self._end - room)

    def tail_bytes(self, notes: Notes) -> int:
        """Return how much room `finish` needs, in bytes."""
        return len(self._tail(notes))

    def info(self) -> FileInfo:
        """Return what the chunks on disk hold."""
        return self._info(self._chunks)

    def close(self) -> None:
        """Close the file as it is; `finish` comes before."""
        with contextlib.suppress(OSError):
            self._out.close()

    def _register(self, topics: Sequence[tuple[Topic, Definition]]) -> None:
        schema_ids: dict[str, int] = {}
        for topic, definition in topics:
            if topic.type not in schema_ids:
                schema_ids[topic.type] = len(schema_ids) + 1
                self._schemas.append(
                    Schema(
                        id=schema_ids[topic.type],
                        name=topic.type,
                        encoding='ros2msg',
                        data=definition.text.encode(),
                    )
                )
            self._channels[topic.name] = Channel(
                id=len(self._channels) + 1,
                topic=topic.name,
                message_encoding='cdr',
                schema_id=schema_ids[topic.type],
                metadata={
                    'offered_qos_profiles': topic.qos_yaml(),
                    'topic_type_hash': definition.type_hash,
                },
            )

    def _encode_head(self, library: str, notes: Notes) -> bytes:
        head = bytearray(_MAGIC + encode_record(Header(profile='ros2', library=library)))
        self._metadata += _add_notes(head, notes, 0)
        for record in (*self._schemas, *self._channels.values()):
            head += encode_record(record)
        return bytes(head)

    def _tail(self, notes: Notes) -> bytes:
        """Return all that follows the last chunk: notes, index, footer."""
        tail = bytearray()
        metadata = [*self._metadata, *_add_notes(tail, notes, self._end)]
        tail += encode_record(DataEnd(data_section_crc=0))
        summary_start = self._end + len(tail)
        groups: list[tuple[Opcode, Sequence[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [self._statistics(len(metadata))]),
            (Opcode.CHUNK_INDEX, [chunk.index for chunk in self._chunks]),
            (Opcode.METADATA_INDEX, metadata),
        ]
        summary = bytearray()
        offsets = bytearray()
        for opcode, records in groups:
            if not records:
                continue
            group = b''.join(map(encode_record, records))
            offsets += encode_record(
                SummaryOffset(opcode, summary_start + len(summary), len(group))
            )
            summary += group
        offsets_start = summary_start + len(summary)
        summary += offsets
        # The checksum covers the footer too, up to where the checksum itself stands.
        summary += encode_record(Footer(summary_start, offsets_start, summary_crc=0))[:-4]
        return bytes(tail + summary + struct.pack('<I', zlib.crc32(summary)) + _MAGIC)

    def _statistics(self, metadata_count: int) -> Statistics:
        counts = self._counts(self._chunks)
        indexes = [chunk.index for chunk in self._chunks]
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=len(indexes),
            message_count=sum(counts.values()),
            message_end_time=max((index.message_end_time for index in indexes), default=0),
            message_start_time=min((index.message_start_time for index in indexes), default=0),
            metadata_count=metadata_count,
            schema_count=len(self._schemas),
        )

    def _counts(self, chunks: Sequence[WrittenChunk]) -> dict[int, int]:
        counts: Counter[int] = Counter()
        for chunk in chunks:
            counts.update(chunk.counts)
        return dict(sorted(counts.items()))

    def _by_name(self, counts: Mapping[int, int]) -> dict[str, int]:
        names = {channel.id: name for name, channel in self._channels.items()}
        return {names[channel_id]: count for channel_id, count in counts.items()}

    def _info(self, chunks: Sequence[WrittenChunk]) -> FileInfo:
        if not chunks:
            return FileInfo(self._path.name)
        return FileInfo(
            self._path.name,
            min(chunk.index.message_start_time for chunk in chunks),
            max(chunk.index.message_end_time for chunk in chunks),
            self._by_name(self._counts(chunks)),
            sum(chunk.payload_bytes for chunk in chunks),
        )

    def _shorten(self, size: int) -> FileInfo:
        """Remove all behind the last chunk that ends within `size` bytes; return the chunks'."""
        removed: list[WrittenChunk] = []
        while self._chunks and self._end > size:
            chunk = self._chunks.pop()
            removed.append(chunk)
            self._end = chunk.index.chunk_start_offset
            self.messages -= chunk.messages
            self.payload_bytes -= chunk.payload_bytes
        self._metadata = [note for note in self._metadata if note.offset < self._end]
        self._out.truncate(self._end)
        return self._info(removed)

    def _append(self, *parts: bytes) -> None:
        self._write(*parts)
        self._end += sum(map(len, parts))

    def _write(self, *parts: bytes) -> None:
        """Write behind the last complete chunk, all or nothing."""
        try:
            self._out.seek(self._end)
            for part in parts:
                rest = memoryview(part)
                while rest:
                    rest = rest[self._out.write(rest) :]
        except OSError:
            self._out.truncate(self._end)
            raise


def _add_notes(data: bytearray, notes: Notes, start: int) -> list[MetadataIndex]:
    """Append the notes to `data`, which begins at `start` in the file; return their index."""
    indexes = []
    for name, pairs in notes.items():
        record = encode_record(Metadata(name=name, metadata=dict(pairs)))
        indexes.append(MetadataIndex(offset=start + len(data), length=len(record), name=name))
        data += record
    return indexes
