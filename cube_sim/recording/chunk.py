"""A chunk: the messages between two flushes, in memory and as MCAP records."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, McapRecord, MessageIndex

# A message record: opcode, length of what follows, channel, sequence, log time, publish time.
_MESSAGE_HEAD = struct.Struct('<BQHIQQ')
_MESSAGE_FIELDS_BYTES = _MESSAGE_HEAD.size - 9
# A chunk record, as far as the name of its compression: opcode, length of what follows, first and
# last log time, size and checksum before compression, length of the name.
_CHUNK_HEAD = struct.Struct('<BQQQQII')


class OpenChunk:
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

    def counts(self) -> dict[int, int]:
        """Return the messages of each channel."""
        return {channel_id: len(rows) for channel_id, rows in self.index.items()}

    def times(self) -> tuple[int, int]:
        """Return the earliest and the latest log time; there is at least one message."""
        times = [time for rows in self.index.values() for time, _ in rows]
        return min(times), max(times)


@dataclass(frozen=True)
class WrittenChunk:
    """What the index and the counts keep of a chunk on disk."""

    index: ChunkIndex
    counts: dict[int, int]  # channel: messages
    payload_bytes: int

    @property
    def messages(self) -> int:
        return sum(self.counts.values())


def encode_record(record: McapRecord) -> bytes:
    """Return an MCAP record as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def encode_chunk(
    chunk: OpenChunk, start: int, compression: str, compress: Callable[[bytes], bytes]
) -> tuple[list[bytes], WrittenChunk]:
    """Return the chunk record and its message indexes, in parts, and what is kept of them.

    start: offset in the file at which it will stand. compression: its name in the format.
    """
    raw = b''.join(chunk.parts)
    compressed = compress(raw)
    first_ns, last_ns = chunk.times()
    name = compression.encode()
    # Not by the mcap package's Chunk, which copies the data three times more.
    fields_bytes = _CHUNK_HEAD.size - 9 + len(name) + 8 + len(compressed)
    head = _CHUNK_HEAD.pack(
        Opcode.CHUNK, fields_bytes, first_ns, last_ns, len(raw), zlib.crc32(raw), len(name)
    )
    head += name + struct.pack('<Q', len(compressed))
    chunk_bytes = len(head) + len(compressed)
    message_indexes = bytearray()
    offsets: dict[int, int] = {}
    for channel_id, rows in chunk.index.items():
        offsets[channel_id] = start + chunk_bytes + len(message_indexes)
        message_indexes += encode_record(MessageIndex(channel_id, rows))
    index = ChunkIndex(
        chunk_start_offset=start,
        chunk_length=chunk_bytes,
        compression=compression,
        compressed_size=len(compressed),
        uncompressed_size=len(raw),
        message_start_time=first_ns,
        message_end_time=last_ns,
        message_index_offsets=offsets,
        message_index_length=len(message_indexes),
    )
    parts = [head, compressed, bytes(message_indexes)]
    return parts, WrittenChunk(index, chunk.counts(), chunk.payload_bytes)
