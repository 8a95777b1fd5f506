"""What a damaged MCAP file still holds, read from front to end.

A message counts as proven if a checksum that covers it fits: that of its chunk. A chunk whose
checksum does not fit is left out whole, because nothing tells which of its messages are wrong.
Where there is no checksum to ask, the structure must do: messages outside of chunks, in chunks
without checksum, and in the front of a chunk that the file's end cuts off are kept if they are
whole, of a known channel and, in a cut-off chunk, of its times, and if what follows them is the
next record or its beginning. `damaged` says how many these are.
"""

from __future__ import annotations

import bisect
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from cube_sim.recording import mcap_records as mcap
from cube_sim.recording.chunk_content import (
    MESSAGE_HEAD,
    MOST_COMPRESSED_BYTES,
    Stored,
    decompressed_front,
    split,
    split_front,
    unpack,
)
from cube_sim.recording.mcap_ends import find_index, read_ends, records_in
from cube_sim.recording.mcap_records import (
    ChannelRecord,
    ChunkHead,
    ChunkIndexRecord,
    DamageError,
    SchemaRecord,
)

_MESSAGE_FIELDS_BYTES = MESSAGE_HEAD.size - mcap.HEAD.size
_PIECE_BYTES = 1 << 20
# Enough of a record to judge it, B.
_FRONT_BYTES = 96
# A schema, channel or note beyond this is taken for damaged, B.
_MOST_RECORD_BYTES = 1 << 24
# The shortest record of each kind, behind opcode and length, B.
_LEAST_BYTES = {
    mcap.HEADER: 8,
    mcap.FOOTER: 20,
    mcap.SCHEMA: 14,
    mcap.CHANNEL: 16,
    mcap.MESSAGE: _MESSAGE_FIELDS_BYTES,
    mcap.CHUNK: 40,
    mcap.MESSAGE_INDEX: 6,
    mcap.CHUNK_INDEX: 64,
    mcap.ATTACHMENT: 36,
    mcap.ATTACHMENT_INDEX: 40,
    mcap.STATISTICS: 46,
    mcap.METADATA: 8,
    mcap.METADATA_INDEX: 20,
    mcap.SUMMARY_OFFSET: 17,
    mcap.DATA_END: 4,
}
_FIXED_BYTES = {mcap.FOOTER, mcap.SUMMARY_OFFSET, mcap.DATA_END}
# Where a record that is worth finding may start: its opcode, and a length below 2^40.
_CANDIDATE = re.compile(rb'(?=[\x03\x04\x05\x06\x0c\x0f].{5}\x00\x00\x00)', re.DOTALL)
_CANDIDATE_BYTES = mcap.HEAD.size


class SavedMessage(NamedTuple):
    """A message out of a damaged file."""

    channel: ChannelRecord
    sequence: int
    time_ns: int
    publish_ns: int
    data: memoryview


class _Step(NamedTuple):
    """What stands at one place of a file."""

    following: int | None
    """Where the next record starts; None if what stands there makes no sense."""
    found: list[Stored]
    """Messages, and the records that they are in."""
    data: memoryview


_NOTHING = memoryview(b'')
_SENSELESS = _Step(None, [], _NOTHING)


class Salvage:
    """Reads one file of which nothing is certain. The methods raise OSError alone.

    What is known of it grows while `messages` is read: schemas and channels by number, notes (the
    last metadata record of each name), chunks (how many were sound), compression of the first,
    lost_bytes (of what was left out or jumped over) and damaged (what was wrong, and where).
    """

    def __init__(self, path: Path, progress: Callable[[int], None]) -> None:
        """Look at the file's end; `progress` is told how far reading has come, B."""
        self.schemas: dict[int, SchemaRecord] = {}
        self.channels: dict[int, ChannelRecord] = {}
        self.notes: dict[str, dict[str, str]] = {}
        self.chunks = 0
        self.compression = ''
        self.lost_bytes = 0
        self.damaged: list[str] = []
        self._path = path
        self._progress = progress
        self._index: dict[int, ChunkIndexRecord] = {}
        self._chunked = False
        # Whether record has followed record since the start or the last sound chunk. After a
        # search, what looks like a message may be inside of a chunk that is broken.
        self._unbroken = True
        self._unknown = 0  # messages of channels that nothing describes
        self._unchecked = 0  # messages that no checksum covers
        with path.open('rb') as stream:
            self._size = os.fstat(stream.fileno()).st_size
            self._end = self._size
            self._cut = False
            self._read_index(stream)
        self._offsets = sorted(self._index)

    def messages(self) -> Iterator[SavedMessage]:
        """Yield what is sound, in the order of the file."""
        at = len(mcap.MAGIC)
        with self._path.open('rb') as stream:
            while at < self._end:
                following, found, data = self._record(stream, at)
                self._unbroken &= following is not None
                if following is None:
                    following = self._search(stream, at)
                    self._lose(at, following, f'nothing makes sense up to byte {following}')
                for channel_id, time_ns, start, end in found:
                    channel = self.channels.get(channel_id)
                    if channel is None:
                        self._unknown += 1
                        continue
                    head = MESSAGE_HEAD.unpack_from(data, start - MESSAGE_HEAD.size)
                    yield SavedMessage(channel, head[3], time_ns, head[5], data[start:end])
                at = following
                self._progress(min(at, self._size))
        if self.damaged and self._unchecked:
            self._note(f'{self._unchecked} messages have no checksum and are kept unchecked')
        if self._unknown:
            self._note(f'{self._unknown} messages are of a channel that nothing describes')

    def _read_index(self, stream: BinaryIO) -> None:
        try:
            ends = read_ends(stream)
            self._end = ends.data_end
            for opcode, body in records_in(ends.summary or memoryview(b'')):
                if opcode == mcap.CHUNK_INDEX:
                    chunk = ChunkIndexRecord.parse(body)
                    self._index[chunk.offset] = chunk
                    self._chunked = True
                else:
                    self._learn(opcode, body)
        except DamageError as error:
            self._note(str(error))
            # Only what is cut off ends otherwise than with the magic bytes.
            self._cut = self._read(stream, self._size - 8, 8) != mcap.MAGIC
            start = max(0, self._size - _MOST_RECORD_BYTES)
            index = find_index(self._read(stream, start, _MOST_RECORD_BYTES))
            for opcode, body in records_in(index or _NOTHING):
                # It is sound, but where it says that chunks are, they are not.
                self._chunked |= opcode == mcap.CHUNK_INDEX
                self._learn(opcode, body)

    def _record(self, stream: BinaryIO, at: int, searching: bool = False) -> _Step:
        """Take in the record at `at`."""
        front = self._read(stream, at, _FRONT_BYTES)
        if len(front) < mcap.HEAD.size:
            return _SENSELESS
        if at in self._index or front[0] == mcap.CHUNK:
            return self._chunk(stream, at, front)
        if not self._plausible(front, at):
            return _SENSELESS
        opcode, length = mcap.HEAD.unpack_from(front)
        following = at + mcap.HEAD.size + length
        if following > self._end:
            if opcode == mcap.MESSAGE and not searching:
                self._lose(at, self._end, 'a message is cut off')
                return _Step(self._end, [], _NOTHING)
            return _SENSELESS
        if opcode in (mcap.SCHEMA, mcap.CHANNEL, mcap.METADATA):
            if length > _MOST_RECORD_BYTES:
                return _SENSELESS
            try:
                self._learn(opcode, self._read(stream, at + mcap.HEAD.size, length))
            except DamageError:
                return _SENSELESS
        elif searching and opcode not in (mcap.MESSAGE, mcap.DATA_END):
            return _SENSELESS
        # A wrong length, or a stretch that is missing, shows in what comes next.
        if not self._plausible(self._read(stream, following, _FRONT_BYTES), following):
            return _SENSELESS
        if opcode in (mcap.FOOTER, mcap.DATA_END):
            # What comes behind is an index that was broken, or it would have told its place.
            return _Step(self._size, [], _NOTHING)
        if opcode != mcap.MESSAGE:
            return _Step(following, [], _NOTHING)
        if self._chunked and not self._unbroken:
            return _SENSELESS
        data = self._read(stream, at, following - at)
        found: list[Stored] = []
        split_front(data, lambda opcode, body: None, found)
        self._unchecked += len(found)
        return _Step(following, found, data)

    def _chunk(self, stream: BinaryIO, at: int, front: memoryview) -> _Step:
        """Take in a chunk. Its length stands there twice, and again in the file's index."""
        index = self._index.get(at)
        try:
            told = mcap.HEAD.unpack_from(front)[1]
            head = _head(index, front[mcap.HEAD.size :])
        except DamageError:
            return _SENSELESS
        start = at + mcap.HEAD.size + head.data_at
        end = start + head.stored_size
        behind = end + (index.message_index_length if index else 0)
        consistent = end == at + mcap.HEAD.size + told
        if end > self._end:
            return self._cut_off(stream, at, head) if consistent and self._cut else _SENSELESS
        self._chunked = True
        try:
            if head.stored_size > max(head.size, MOST_COMPRESSED_BYTES):
                raise DamageError('claims too much')
            data = unpack(head, self._read(stream, start, head.stored_size))
            learned: list[tuple[int, memoryview]] = []
            found = split(data, lambda opcode, body: learned.append((opcode, body)))
            for opcode, body in learned:
                self._learn(opcode, body)
        except DamageError as error:
            following = self._read(stream, end, _FRONT_BYTES)
            if not index and not (consistent and self._plausible(following, end)):
                return _SENSELESS
            self._lose(at, end, f'the chunk {error}')
            return _Step(behind, [], _NOTHING)
        if not head.crc:
            self._unchecked += len(found)
        if not self.chunks:
            self.compression = head.compression
        self.chunks += 1
        self._unbroken = True
        return _Step(behind, found, data)

    def _cut_off(self, stream: BinaryIO, at: int, head: ChunkHead) -> _Step:
        """Return the messages of a chunk that goes beyond the file's end."""
        self._chunked = True
        start = at + mcap.HEAD.size + head.data_at
        stored = self._read(stream, start, min(self._end - start, MOST_COMPRESSED_BYTES))
        data = memoryview(decompressed_front(head.compression, stored, head.size))
        found: list[Stored] = []
        learned: list[tuple[int, memoryview]] = []
        try:
            rest = split_front(data, lambda opcode, body: learned.append((opcode, body)), found)
            for opcode, body in learned:
                if opcode not in (mcap.SCHEMA, mcap.CHANNEL):
                    raise DamageError('holds what no chunk does')
                self._learn(opcode, body)
            whole = self._begins_a_record(data[rest:], head.size - rest) and all(
                head.first_ns <= time_ns <= head.last_ns and channel in self.channels
                for channel, time_ns, _, _ in found
            )
        except DamageError:
            whole = False
        if not whole:
            found = []
        self._unchecked += len(found)
        # How much of compressed bytes is kept has no exact answer.
        kept_to = start + found[-1][3] if found and not head.compression else at
        kept = f'its first {len(found)} messages are kept'
        self._lose(kept_to, self._end, f'the chunk from {at} on is cut off, and {kept}')
        return _Step(self._end, found, data)

    def _begins_a_record(self, data: memoryview, room: int) -> bool:
        """Say whether `data`, with what was cut off, can be a record of at most `room` bytes."""
        if len(data) < mcap.HEAD.size:
            return not data or data[0] in (mcap.SCHEMA, mcap.CHANNEL, mcap.MESSAGE)
        opcode, length = mcap.HEAD.unpack_from(data)
        if opcode not in (mcap.SCHEMA, mcap.CHANNEL, mcap.MESSAGE):
            return False
        return length <= room - mcap.HEAD.size and self._has_known_channel(opcode, data)

    def _plausible(self, front: memoryview, at: int) -> bool:
        """Say whether what starts with `front` can be a record, or a record's cut-off start."""
        if at >= self._end:
            return at == self._end or at == self._size
        if len(front) < mcap.HEAD.size:
            return self._cut
        opcode, length = mcap.HEAD.unpack_from(front)
        if opcode >= 0x80:  # other tools' own
            return bool(at + mcap.HEAD.size + length <= self._end)
        least = _LEAST_BYTES.get(opcode)
        if least is None or length < least or (opcode in _FIXED_BYTES and length != least):
            return False
        body = front[mcap.HEAD.size :]
        if opcode == mcap.CHUNK:
            try:
                head = ChunkHead.parse(body)
            except DamageError:
                return self._cut and at + len(front) == self._size
            return bool(head.data_at + head.stored_size == length)
        if opcode == mcap.MESSAGE_INDEX and len(body) >= least:
            size = int.from_bytes(body[2:6], 'little')
            if size != length - least:
                return False
        if not self._has_known_channel(opcode, front):
            return False
        return self._cut or at + mcap.HEAD.size + length <= self._size

    def _has_known_channel(self, opcode: int, front: memoryview) -> bool:
        if opcode != mcap.MESSAGE or len(front) < mcap.HEAD.size + 2:
            return True
        return int.from_bytes(front[mcap.HEAD.size : mcap.HEAD.size + 2], 'little') in self.channels

    def _search(self, stream: BinaryIO, at: int) -> int:
        """Return where the next record starts that makes sense."""
        known = bisect.bisect_right(self._offsets, at)
        end = self._offsets[known] if known < len(self._offsets) else self._end
        start = at + 1
        while start < end:
            # Pieces overlap, so that none is the border within a candidate.
            piece = self._read(stream, start, min(_PIECE_BYTES, end - start) + _CANDIDATE_BYTES)
            for match in _CANDIDATE.finditer(piece):
                candidate = start + match.start()
                if candidate >= end:
                    break
                if self._makes_sense(stream, candidate):
                    return candidate
            start += _PIECE_BYTES
        return end

    def _makes_sense(self, stream: BinaryIO, at: int) -> bool:
        before = self.__dict__.copy()
        noted = len(self.damaged)
        self._unbroken = False
        following, _, _ = self._record(stream, at, searching=True)
        # It is read again, and counted, when its turn comes.
        self.__dict__.update(before)
        del self.damaged[noted:]
        return following is not None

    def _learn(self, opcode: int, body: memoryview) -> None:
        """Keep what a record describes. The index comes first, and the first one counts."""
        if opcode == mcap.SCHEMA:
            schema = SchemaRecord.parse(body)
            self.schemas.setdefault(schema.id, schema)
        elif opcode == mcap.CHANNEL:
            channel = ChannelRecord.parse(body)
            self.channels.setdefault(channel.id, channel)
        elif opcode == mcap.METADATA:
            name, pairs = mcap.parse_metadata(body)
            self.notes[name] = pairs

    def _lose(self, start: int, end: int, what: str) -> None:
        self.lost_bytes += end - start
        self._note(f'byte {start}: {what}')

    def _note(self, what: str) -> None:
        self.damaged.append(f'{self._path.name}, {what}')

    def _read(self, stream: BinaryIO, at: int, most: int) -> memoryview:
        """Read up to `most` bytes of those that there are."""
        if at < 0 or at >= self._size:
            return memoryview(b'')
        stream.seek(at)
        return memoryview(stream.read(min(most, self._size - at)))


def _head(index: ChunkIndexRecord | None, body: memoryview) -> ChunkHead:
    """Return the head of a chunk; the file's index knows it better than the chunk itself."""
    if index is None:
        head = ChunkHead.parse(body)
        if head.compression not in ('', 'lz4', 'zstd'):
            raise DamageError('is compressed in an unknown way')
        return head
    # The fields before the checksum, and from it to the data, are of fixed sizes.
    crc = int.from_bytes(body[24:28], 'little')
    data_at = 40 + len(index.compression)
    return ChunkHead(
        index.first_ns,
        index.last_ns,
        index.size,
        crc,
        index.compression,
        index.stored_size,
        data_at,
    )
