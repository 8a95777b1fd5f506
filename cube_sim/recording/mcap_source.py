"""One sound MCAP file, opened for reading: what is in it, and its messages chunk by chunk.

Two ways lead to the list of chunks. The file's own index is used if it is there, fits its
checksum, and lists every chunk of the file. Otherwise the whole file is read once, and messages
that stand outside of chunks are gathered into stretches, which are read like chunks from then on.
"""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from cube_sim.recording import mcap_records as mcap
from cube_sim.recording.chunk_content import Stored, split, unpack
from cube_sim.recording.mcap_ends import read_ends, read_exactly, records_in
from cube_sim.recording.mcap_records import (
    ChannelRecord,
    ChunkHead,
    ChunkIndexRecord,
    DamageError,
    SchemaRecord,
    StatisticsRecord,
)

# Messages outside of chunks are read in stretches of about this size, B.
_STRETCH_BYTES = 1 << 20
_PIECE_BYTES = 1 << 20
# A record that is not a chunk, beyond this is taken for damaged, B.
_MOST_RECORD_BYTES = 1 << 28
# Enough of a chunk for what it says of itself.
_CHUNK_HEAD_BYTES = 64
_NO_SCHEMA = 0
_NO_CHANNELS: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Place:
    """Where a chunk, or a stretch of messages outside of chunks, stands in its file."""

    offset: int
    length: int
    first_ns: int
    last_ns: int
    size: int
    """Of its records in memory, B."""
    channels: frozenset[int]
    """Those that have messages there; empty if this is not known."""
    bare: bool = False
    """Whether it is a stretch outside of chunks."""


class McapSource:
    """What one file holds. All methods raise DamageError or OSError.

    first_ns, last_ns are those of the messages, 0 without any; notes are the metadata records,
    the last of each name.
    """

    def __init__(self, path: Path) -> None:
        """Read the index of `path`, or, without a good one, the whole file."""
        self.path = path
        self.schemas: dict[int, SchemaRecord] = {}
        self.channels: dict[int, ChannelRecord] = {}
        self.places: list[Place] = []
        self.counts: Counter[int] = Counter()
        self.notes: dict[str, dict[str, str]] = {}
        self.first_ns = self.last_ns = 0
        self._data_checked = False
        with path.open('rb') as stream:
            self._data_end, self._data_crc, index = read_ends(stream)
            if index is None or not self._use(index, stream):
                self._read_all(stream)

    @property
    def messages(self) -> int:
        """Messages in the file."""
        return sum(self.counts.values())

    def load(self, place: Place) -> tuple[memoryview, list[Stored]]:
        """Return the records of `place` and the messages among them, in the order of the file."""
        with self.path.open('rb') as stream:
            data = self._content(stream, place)
        found = split(data, self._compare)
        for channel, time_ns, _, _ in found:
            if channel not in self.channels:
                raise DamageError(f'the chunk at {place.offset} has messages of an unknown channel')
            if not place.first_ns <= time_ns <= place.last_ns:
                raise DamageError(f'the chunk at {place.offset} has messages of other times')
        return data, found

    def _use(self, index: memoryview, stream: BinaryIO) -> bool:
        """Take over the file's index; False if it leaves something out."""
        chunks: list[ChunkIndexRecord] = []
        statistics = None
        for opcode, body in records_in(index):
            if opcode == mcap.CHUNK_INDEX:
                chunks.append(ChunkIndexRecord.parse(body))
            elif opcode == mcap.STATISTICS:
                statistics = StatisticsRecord.parse(body)
            else:
                self._add(opcode, body)
        if (
            statistics is None
            or statistics.chunks != len(chunks)
            or statistics.channels != len(self.channels)
            or statistics.messages != sum(statistics.counts.values())
            or not statistics.counts.keys() <= self.channels.keys()
            or not {channel.schema_id for channel in self.channels.values()}
            <= self.schemas.keys() | {_NO_SCHEMA}
        ):
            return False
        chunks.sort(key=lambda chunk: chunk.offset)
        if not self._walk_between(chunks, stream):
            return False
        self.places = [
            Place(
                chunk.offset,
                chunk.length,
                chunk.first_ns,
                chunk.last_ns,
                chunk.size,
                chunk.channels,
            )
            for chunk in chunks
        ]
        self.counts.update(statistics.counts)
        self.first_ns, self.last_ns = statistics.first_ns, statistics.last_ns
        return True

    def _walk_between(self, chunks: list[ChunkIndexRecord], stream: BinaryIO) -> bool:
        """Read the notes between the chunks; False if there are messages that are in none."""
        at = len(mcap.MAGIC)
        for chunk in [*chunks, None]:
            goal = self._data_end if chunk is None else chunk.offset
            if goal > self._data_end:
                raise DamageError('its index points outside of the file')
            while at < goal:
                opcode, length = self._head(stream, at, goal)
                if opcode in (mcap.MESSAGE, mcap.CHUNK):
                    return False
                if opcode == mcap.METADATA:
                    self._add(opcode, read_exactly(stream, at + mcap.HEAD.size, length))
                at += mcap.HEAD.size + length
            if at != goal:
                raise DamageError(f'its index does not fit what stands at {goal}')
            if chunk is not None:
                at = goal + chunk.length + chunk.message_index_length
        return True

    def _read_all(self, stream: BinaryIO) -> None:
        """Read the file from front to end, as if it had no index."""
        self.schemas, self.channels, self.notes = {}, {}, {}
        self._check_data()
        at = len(mcap.MAGIC)
        stretch_at = at
        stretch: list[tuple[int, int]] = []  # channel and time of each message in it
        while at < self._data_end:
            opcode, length = self._head(stream, at, self._data_end)
            end = at + mcap.HEAD.size + length
            if opcode == mcap.CHUNK:
                self._add_chunk(stream, at, end)
            elif opcode == mcap.MESSAGE:
                if not stretch:
                    stretch_at = at
                # A short one shows when the stretch is read.
                front = read_exactly(stream, at + mcap.HEAD.size, min(length, 14))
                fields = mcap.Fields(front, f'the message at {at}')
                channel, _, time_ns = fields.integer(2), fields.integer(4), fields.integer(8)
                stretch.append((channel, time_ns))
            elif opcode in (mcap.SCHEMA, mcap.CHANNEL, mcap.METADATA):
                self._add(opcode, read_exactly(stream, at + mcap.HEAD.size, length))
            if stretch and (opcode != mcap.MESSAGE or end - stretch_at > _STRETCH_BYTES):
                stretch_end = end if opcode == mcap.MESSAGE else at
                self._add_place(stretch_at, stretch_end, stretch_end - stretch_at, stretch, True)
                stretch = []
            at = end
        if stretch:
            self._add_place(stretch_at, at, at - stretch_at, stretch, True)
        self.first_ns = min((place.first_ns for place in self.places), default=0)
        self.last_ns = max((place.last_ns for place in self.places), default=0)
        unknown = self.counts.keys() - self.channels.keys()
        if unknown:
            raise DamageError(f'it has messages of the unknown channel {min(unknown)}')

    def _add_chunk(self, stream: BinaryIO, at: int, end: int) -> None:
        place = Place(at, end - at, 0, 2**64 - 1, 0, _NO_CHANNELS)
        data = self._content(stream, place)
        found = split(data, self._add)
        if found:
            self._add_place(at, end, len(data), [row[:2] for row in found], False)

    def _add_place(
        self, at: int, end: int, size: int, messages: list[tuple[int, int]], bare: bool
    ) -> None:
        times = [time_ns for _, time_ns in messages]
        counts = Counter(channel for channel, _ in messages)
        self.counts.update(counts)
        channels = frozenset(counts)
        self.places.append(Place(at, end - at, min(times), max(times), size, channels, bare))

    def _content(self, stream: BinaryIO, place: Place) -> memoryview:
        """Return the records of `place`, sound as far as there are checksums."""
        if place.bare:
            self._check_data()
            return read_exactly(stream, place.offset, place.length)
        front = read_exactly(stream, place.offset, min(place.length, _CHUNK_HEAD_BYTES))
        body = front[mcap.HEAD.size :]
        length = place.length - mcap.HEAD.size
        if len(front) < _CHUNK_HEAD_BYTES // 2 or mcap.HEAD.unpack_from(front) != (
            mcap.CHUNK,
            length,
        ):
            raise DamageError(f'there is no chunk at {place.offset}, where one should be')
        head = ChunkHead.parse(body)
        if head.data_at + head.stored_size != length or place.size not in (0, head.size):
            raise DamageError(f'the chunk at {place.offset} has another size than it should')
        if not head.crc:
            self._check_data()
        try:
            at = place.offset + mcap.HEAD.size + head.data_at
            return unpack(head, read_exactly(stream, at, head.stored_size))
        except DamageError as error:
            raise DamageError(f'the chunk at {place.offset} {error}') from None

    def _check_data(self) -> None:
        """Hold all that precedes the index against the file's own checksum, if it has one."""
        if self._data_checked or not self._data_crc:
            return
        crc = 0
        with self.path.open('rb') as stream:
            for at in range(0, self._data_end, _PIECE_BYTES):
                size = min(_PIECE_BYTES, self._data_end - at)
                crc = zlib.crc32(read_exactly(stream, at, size), crc)
        if crc != self._data_crc:
            raise DamageError('its messages do not fit the checksum over all of them')
        self._data_checked = True

    def _head(self, stream: BinaryIO, at: int, end: int) -> tuple[int, int]:
        """Return opcode and length of the record at `at`, which must end before `end`."""
        if end - at < mcap.HEAD.size:
            raise DamageError(f'there is no whole record at {at}')
        opcode, length = mcap.HEAD.unpack(read_exactly(stream, at, mcap.HEAD.size))
        if opcode == 0 or length > end - at - mcap.HEAD.size:
            raise DamageError(f'there is no whole record at {at}')
        if length > _MOST_RECORD_BYTES and opcode in (mcap.SCHEMA, mcap.CHANNEL, mcap.METADATA):
            raise DamageError(f'the record at {at} claims {length} bytes, more than any has')
        return opcode, length

    def _add(self, opcode: int, body: memoryview) -> None:
        """Keep a schema, a channel or a note. What was there before must be the same."""
        if opcode == mcap.SCHEMA:
            schema = SchemaRecord.parse(body)
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise DamageError(f'it has two schemas of the number {schema.id}')
        elif opcode == mcap.CHANNEL:
            channel = ChannelRecord.parse(body)
            if self.channels.setdefault(channel.id, channel) != channel:
                raise DamageError(f'it has two channels of the number {channel.id}')
        elif opcode == mcap.METADATA:
            name, pairs = mcap.parse_metadata(body)
            self.notes[name] = pairs

    def _compare(self, opcode: int, body: memoryview) -> None:
        if opcode == mcap.CHANNEL and ChannelRecord.parse(body).id not in self.channels:
            raise DamageError('its index leaves out a channel')
        self._add(opcode, body)
