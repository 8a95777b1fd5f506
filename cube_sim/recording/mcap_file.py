"""One MCAP file: messages in, chunks on disk, and an index at the end.

The records are those of the `mcap` package. Their order is kept here and not by its `Writer`,
for two reasons. Schemas and channels stand at the front of the file, outside of any chunk, so a
file that was killed at any moment still says what it is. And the index stays in reach, so a file
whose disk ran full can be cut back to its last complete chunk and still be finished properly.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from cube_sim.recording.definitions import Definition
from cube_sim.recording.errors import RecordingError
from cube_sim.recording.metadata import FileInfo
from cube_sim.recording.topic import Topic

Compression = Literal['none', 'lz4', 'zstd']
Notes = Mapping[str, Mapping[str, str]]
"""Metadata records: name to keys and values."""

_MAGIC = b'\x89MCAP0\r\n'
# A message record: opcode, length of what follows, channel, sequence, log time, publish time.
_MESSAGE_HEAD = struct.Struct('<BQHIQQ')
_MESSAGE_FIELDS_BYTES = _MESSAGE_HEAD.size - 9


class _OpenChunk:
    """The messages since the last chunk, in memory."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self.payload_bytes = 0
        self.index: dict[int, list[tuple[int, int]]] = {}  # channel: (log time, offset) each

    @property
    def messages(self) -> int:
        return sum(map(len, self.index.values()))

    def add(self, channel_id: int, sequence: int, log_time_ns: int, data: bytes) -> None:
        self.index.setdefault(channel_id, []).append((log_time_ns, self.size))
        length = _MESSAGE_FIELDS_BYTES + len(data)
        head = _MESSAGE_HEAD.pack(
            Opcode.MESSAGE, length, channel_id, sequence & 0xFFFFFFFF, log_time_ns, log_time_ns
        )
        self.parts += (head, data)
        self.size += len(head) + len(data)
        self.payload_bytes += len(data)


@dataclass(frozen=True)
class _WrittenChunk:
    """What the index and the counts keep of a chunk on disk."""

    index: ChunkIndex
    counts: dict[int, int]  # channel: messages
    payload_bytes: int


class McapFile:
    """Writes one MCAP file of profile `ros2`.

    Each write goes to the operating system at once and holds whole chunks: what was flushed
    survives the death of the process (not a power cut: nothing is forced to the disk itself).
    After an OSError the file ends behind its last complete chunk, and `finish` may be tried again.

    messages, payload_bytes: what the file holds, the open chunk included; B without MCAP overhead.
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
        """Create the file and write all but messages.

        chunk_size: B of messages, above which a chunk ends.
        Raises OSError, and RecordingError if the compression is not known or not installed.
        """
        self.messages = 0
        self.payload_bytes = 0
        self._path = path
        self._compression = '' if compression == 'none' else compression
        self._compress = _compressor(compression)
        self._chunk_size = chunk_size
        self._schemas: list[Schema] = []
        self._channels: dict[str, Channel] = {}
        self._sequences: Counter[int] = Counter()
        self._open_chunk = _OpenChunk()
        self._chunks: list[_WrittenChunk] = []
        self._metadata: list[MetadataIndex] = []
        self._end = 0  # behind the last complete chunk; what follows may be cut off
        self._register(topics)
        self._out = path.open('xb', buffering=0)
        try:
            self._append(self._head(library, notes))
        except OSError:
            self._out.close()
            raise

    def write(self, topic_name: str, log_time_ns: int, data: bytes) -> None:
        """Add a message; its publish time is its log time.

        Raises OSError if a chunk could not be written; the messages in it are lost.
        """
        channel_id = self._channels[topic_name].id
        self._open_chunk.add(channel_id, self._sequences[channel_id], log_time_ns, data)
        self._sequences[channel_id] += 1
        self.messages += 1
        self.payload_bytes += len(data)
        if self._open_chunk.size > self._chunk_size:
            self.flush()

    def flush(self) -> None:
        """End the chunk and hand it to the operating system.

        Raises OSError if it could not be written; the messages in it are lost.
        """
        chunk, self._open_chunk = self._open_chunk, _OpenChunk()
        if not chunk.index:
            return
        record, message_indexes, index = self._encode_chunk(chunk)
        try:
            self._append(record, message_indexes)
        except OSError:
            self.messages -= chunk.messages
            self.payload_bytes -= chunk.payload_bytes
            raise
        counts = {channel_id: len(rows) for channel_id, rows in chunk.index.items()}
        self._chunks.append(_WrittenChunk(index, counts, chunk.payload_bytes))

    def finish(self, notes: Notes) -> None:
        """Write the notes and the index, which make the file whole; may be repeated.

        Raises OSError; what was flushed stays.
        """
        self.flush()
        self._write(self._tail(notes))

    def cut_back(self, room: int) -> None:
        """Remove the index, and chunks from the end until at least `room` bytes are free."""
        wanted_end = self._end - room
        while self._chunks and self._end > wanted_end:
            chunk = self._chunks.pop()
            self._end = chunk.index.chunk_start_offset
            self.messages -= sum(chunk.counts.values())
            self.payload_bytes -= chunk.payload_bytes
        self._out.truncate(self._end)

    def tail_bytes(self, notes: Notes) -> int:
        """Return how much room `finish` needs, in bytes."""
        return len(self._tail(notes))

    def info(self) -> FileInfo:
        """Return what the chunks on disk hold."""
        if not self._chunks:
            return FileInfo(self._path.name)
        names = {channel.id: name for name, channel in self._channels.items()}
        return FileInfo(
            self._path.name,
            min(chunk.index.message_start_time for chunk in self._chunks),
            max(chunk.index.message_end_time for chunk in self._chunks),
            {names[channel_id]: count for channel_id, count in self._counts().items()},
        )

    def close(self) -> None:
        """Close the file as it is; `finish` comes before."""
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

    def _head(self, library: str, notes: Notes) -> bytes:
        head = bytearray(_MAGIC + _encode(Header(profile='ros2', library=library)))
        self._metadata += _add_notes(head, notes, 0)
        for record in (*self._schemas, *self._channels.values()):
            head += _encode(record)
        return bytes(head)

    def _encode_chunk(self, chunk: _OpenChunk) -> tuple[bytes, bytes, ChunkIndex]:
        """Return the chunk and its message indexes as they follow in the file, and its index."""
        raw = b''.join(chunk.parts)
        compressed = self._compress(raw)
        times = [time for rows in chunk.index.values() for time, _ in rows]
        record = Chunk(
            compression=self._compression,
            data=compressed,
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(raw),
            uncompressed_size=len(raw),
        )
        encoded = _encode(record)
        message_indexes = bytearray()
        offsets: dict[int, int] = {}
        for channel_id, rows in chunk.index.items():
            offsets[channel_id] = self._end + len(encoded) + len(message_indexes)
            message_indexes += _encode(MessageIndex(channel_id, rows))
        index = ChunkIndex(
            chunk_start_offset=self._end,
            chunk_length=len(encoded),
            compression=self._compression,
            compressed_size=len(compressed),
            uncompressed_size=len(raw),
            message_start_time=record.message_start_time,
            message_end_time=record.message_end_time,
            message_index_offsets=offsets,
            message_index_length=len(message_indexes),
        )
        return encoded, bytes(message_indexes), index

    def _tail(self, notes: Notes) -> bytes:
        """Return all that follows the last chunk: notes, index, footer."""
        tail = bytearray()
        metadata = [*self._metadata, *_add_notes(tail, notes, self._end)]
        tail += _encode(DataEnd(data_section_crc=0))
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
            group = b''.join(map(_encode, records))
            offsets += _encode(SummaryOffset(opcode, summary_start + len(summary), len(group)))
            summary += group
        offsets_start = summary_start + len(summary)
        summary += offsets
        # The checksum covers the footer too, up to where the checksum itself stands.
        summary += _encode(Footer(summary_start, offsets_start, summary_crc=0))[:-4]
        return bytes(tail + summary + struct.pack('<I', zlib.crc32(summary)) + _MAGIC)

    def _statistics(self, metadata_count: int) -> Statistics:
        counts = self._counts()
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

    def _counts(self) -> dict[int, int]:
        counts: Counter[int] = Counter()
        for chunk in self._chunks:
            counts.update(chunk.counts)
        return dict(sorted(counts.items()))

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
        record = _encode(Metadata(name=name, metadata=dict(pairs)))
        indexes.append(MetadataIndex(offset=start + len(data), length=len(record), name=name))
        data += record
    return indexes


def _encode(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _compressor(compression: str) -> Callable[[bytes], bytes]:
    """Return the function that compresses a chunk; its package is imported here, if one is needed.

    Raises RecordingError.
    """
    if compression == 'none':
        return lambda data: data
    try:
        if compression == 'lz4':
            from lz4.frame import (  # type: ignore[import-untyped,unused-ignore]
                compress as lz4_compress,
            )

            return lambda data: bytes(lz4_compress(data))
        if compression == 'zstd':
            from zstandard import compress as zstd_compress

            return lambda data: bytes(zstd_compress(data))
    except ImportError as error:
        raise RecordingError(
            f'Compression {compression} needs the Python package {error.name}; '
            "install it, or choose 'none'."
        ) from error
    raise RecordingError(
        f'Compression {compression!r} is unknown; choose one of {", ".join(get_args(Compression))}.'
    )
