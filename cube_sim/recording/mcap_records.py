"""The records of an MCAP file, read from bytes that may be anything.

Every length is held against what is there before it is used, so no damage makes these functions
read elsewhere, allocate much, or raise anything but DamageError.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
"""What every record starts with: its opcode, and the length of what follows, B."""

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX = range(9, 14)
SUMMARY_OFFSET, DATA_END = 14, 15

# The footer's record and the closing magic stand at fixed distances from the end.
FOOTER_BYTES = HEAD.size + 20
DATA_END_BYTES = HEAD.size + 4


class DamageError(Exception):
    """Says what is wrong with a file, in words that can follow 'it is damaged: '."""


class Fields:
    """A record's fields, one after the other."""

    def __init__(self, data: memoryview, what: str) -> None:
        """Start at the front of `data`, which holds `what`."""
        self._data = data
        self._what = what
        self._at = 0

    def integer(self, size: int) -> int:
        """Read an unsigned integer of `size` bytes."""
        return int.from_bytes(self.take(size), 'little')

    def text(self) -> str:
        """Read a string."""
        try:
            return str(self.take(self.integer(4)), 'utf-8')
        except UnicodeDecodeError:
            raise DamageError(f'{self._what} has a text that is not UTF-8') from None

    def part(self) -> Fields:
        """Read the length of a list or map in bytes; return its content."""
        return Fields(self.take(self.integer(4)), self._what)

    def pairs(self) -> dict[str, str]:
        """Read a map of texts."""
        part = self.part()
        found = {}
        while part.rest():
            name = part.text()
            found[name] = part.text()
        return found

    def numbers(self) -> dict[int, int]:
        """Read a map of channel numbers to 64-bit numbers."""
        part = self.part()
        found = {}
        while part.rest():
            name = part.integer(2)
            found[name] = part.integer(8)
        return found

    def take(self, size: int) -> memoryview:
        """Read `size` bytes."""
        if size > self.rest():
            raise DamageError(f'{self._what} ends too early')
        self._at += size
        return self._data[self._at - size : self._at]

    def rest(self) -> int:
        """Return how many bytes are left."""
        return len(self._data) - self._at


@dataclass(frozen=True)
class SchemaRecord:
    """A message type and its definition."""

    id: int
    name: str
    encoding: str
    data: bytes

    @staticmethod
    def parse(body: memoryview) -> SchemaRecord:
        fields = Fields(body, 'a schema')
        schema_id, name, encoding = fields.integer(2), fields.text(), fields.text()
        data = bytes(fields.take(fields.integer(4)))
        _finish(fields, 'a schema')
        return SchemaRecord(schema_id, name, encoding, data)


@dataclass(frozen=True)
class ChannelRecord:
    """A stream of messages of one topic and type."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: dict[str, str]

    @staticmethod
    def parse(body: memoryview) -> ChannelRecord:
        fields = Fields(body, 'a channel')
        channel = ChannelRecord(
            fields.integer(2), fields.integer(2), fields.text(), fields.text(), fields.pairs()
        )
        _finish(fields, 'a channel')
        return channel


@dataclass(frozen=True)
class ChunkHead:
    """What a chunk says of itself before its messages."""

    first_ns: int
    last_ns: int
    size: int
    """Of the records in it, B, once they are not compressed."""
    crc: int
    """Of the same; 0 if there is none."""
    compression: str
    stored_size: int
    """Of the same as they stand in the file, B."""
    data_at: int
    """Where they start in the chunk's record behind opcode and length."""

    @staticmethod
    def parse(body: memoryview) -> ChunkHead:
        """Read the head of a chunk whose messages may be cut off."""
        fields = Fields(body, 'a chunk')
        first, last, size, crc = (fields.integer(width) for width in (8, 8, 8, 4))
        compression, stored = fields.text(), fields.integer(8)
        return ChunkHead(first, last, size, crc, compression, stored, len(body) - fields.rest())


@dataclass(frozen=True)
class ChunkIndexRecord:
    """Where a chunk stands, and what it says of itself."""

    first_ns: int
    last_ns: int
    offset: int
    length: int
    channels: frozenset[int]
    """Those that have messages in the chunk; empty if this is not known."""
    message_index_length: int
    compression: str
    stored_size: int
    size: int

    @staticmethod
    def parse(body: memoryview) -> ChunkIndexRecord:
        fields = Fields(body, 'a chunk index')
        first, last, offset, length = (fields.integer(8) for _ in range(4))
        channels = frozenset(fields.numbers())
        index_length, compression = fields.integer(8), fields.text()
        stored, size = fields.integer(8), fields.integer(8)
        _finish(fields, 'a chunk index')
        return ChunkIndexRecord(
            first, last, offset, length, channels, index_length, compression, stored, size
        )


@dataclass(frozen=True)
class StatisticsRecord:
    """What is counted over the whole file."""

    messages: int
    channels: int
    chunks: int
    first_ns: int
    last_ns: int
    counts: dict[int, int]
    """Messages by channel."""

    @staticmethod
    def parse(body: memoryview) -> StatisticsRecord:
        fields = Fields(body, 'the statistics')
        messages, _, channels = (fields.integer(width) for width in (8, 2, 4))
        _, _, chunks = (fields.integer(4) for _ in range(3))
        first, last, counts = fields.integer(8), fields.integer(8), fields.numbers()
        _finish(fields, 'the statistics')
        return StatisticsRecord(messages, channels, chunks, first, last, counts)


def parse_metadata(body: memoryview) -> tuple[str, dict[str, str]]:
    """Return name and pairs of a metadata record."""
    fields = Fields(body, 'a metadata record')
    note = fields.text(), fields.pairs()
    _finish(fields, 'a metadata record')
    return note


def _finish(fields: Fields, what: str) -> None:
    if fields.rest():
        raise DamageError(f'{what} is longer than its fields')
