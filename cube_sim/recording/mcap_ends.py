"""How an MCAP file starts and ends, and the index at its end."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from cube_sim.recording import mcap_records as mcap
from cube_sim.recording.mcap_records import DamageError

# An index beyond this is taken for damaged, B.
_MOST_INDEX_BYTES = 1 << 30


class Ends(NamedTuple):
    """What the last bytes of a file say of those before."""

    data_end: int
    """Where the messages end."""
    data_crc: int
    """Of all before that; 0 if there is none."""
    summary: memoryview | None
    """The index as it stands in the file, if it fits its checksum; None without checksum."""


def read_ends(stream: BinaryIO) -> Ends:
    """Check how a file starts and ends. Raises DamageError, and OSError."""
    size = os.fstat(stream.fileno()).st_size
    if size == 0:
        raise DamageError('it is empty')
    if read_exactly(stream, 0, min(size, len(mcap.MAGIC))) != mcap.MAGIC:
        raise DamageError('it does not start as an MCAP file')
    footer_at = size - len(mcap.MAGIC) - mcap.FOOTER_BYTES
    if footer_at < len(mcap.MAGIC) + mcap.DATA_END_BYTES:
        raise DamageError('it ends too early')
    footer = read_exactly(stream, footer_at, mcap.FOOTER_BYTES + len(mcap.MAGIC))
    if footer[-8:] != mcap.MAGIC or mcap.HEAD.unpack_from(footer) != (mcap.FOOTER, 20):
        raise DamageError('it ends without an index')
    fields = mcap.Fields(footer[mcap.HEAD.size :], 'the footer')
    start, offsets_start, crc = fields.integer(8), fields.integer(8), fields.integer(4)
    data_end = (start or offsets_start or footer_at) - mcap.DATA_END_BYTES
    if not len(mcap.MAGIC) <= data_end <= footer_at - mcap.DATA_END_BYTES:
        raise DamageError('its footer points outside of the file')
    last = read_exactly(stream, data_end, mcap.DATA_END_BYTES)
    if mcap.HEAD.unpack_from(last) != (mcap.DATA_END, 4):
        raise DamageError(f'its messages do not end at {data_end}, where they should')
    data_crc = int.from_bytes(last[mcap.HEAD.size :], 'little')
    if not start or not crc or footer_at - start > _MOST_INDEX_BYTES:
        return Ends(data_end, data_crc, None)
    index = read_exactly(stream, start, footer_at - start)
    # The checksum covers the footer too, up to where the checksum itself stands.
    if zlib.crc32(footer[: mcap.FOOTER_BYTES - 4], zlib.crc32(index)) != crc:
        raise DamageError('its index does not fit its checksum')
    return Ends(data_end, data_crc, index)


def find_index(tail: memoryview) -> memoryview | None:
    """Return the index that ends a file's last bytes, if it is whole, wherever the file says it is.

    In a file that grew or shrank in its middle the index does not stand where its footer says.
    """
    footer_at = len(tail) - len(mcap.MAGIC) - mcap.FOOTER_BYTES
    if footer_at < 0 or tail[-len(mcap.MAGIC) :] != mcap.MAGIC:
        return None
    crc = int.from_bytes(tail[-len(mcap.MAGIC) - 4 : -len(mcap.MAGIC)], 'little')
    content = bytes(tail[: -len(mcap.MAGIC) - 4])
    mark = mcap.HEAD.pack(mcap.DATA_END, 4)
    at = content.rfind(mark)
    while at >= 0 and crc:
        start = at + mcap.DATA_END_BYTES
        if zlib.crc32(tail[start : len(content)]) == crc:
            return tail[start:footer_at]
        at = content.rfind(mark, 0, at)
    return None


def records_in(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield opcode and body of each record in an index. Raises DamageError."""
    at = 0
    while at < len(data):
        if len(data) - at < mcap.HEAD.size:
            raise DamageError('its index ends too early')
        opcode, length = mcap.HEAD.unpack_from(data, at)
        at += mcap.HEAD.size
        if length > len(data) - at:
            raise DamageError('its index ends too early')
        yield opcode, data[at : at + length]
        at += length


def read_exactly(stream: BinaryIO, at: int, size: int) -> memoryview:
    """Read `size` bytes at `at`; both lie within the file as it was opened."""
    stream.seek(at)
    data = stream.read(size)
    if len(data) != size:
        raise DamageError('it became shorter while it was read')
    return memoryview(data)
