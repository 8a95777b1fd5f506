"""A chunk's content: decompressed, held against its checksum, and cut into messages."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

from cube_sim.recording.mcap_records import HEAD, MESSAGE, ChunkHead, DamageError

Stored = tuple[int, int, int, int]
"""A message among the records of a chunk: channel, log time (ns), start and end of its data."""

# A compressed chunk that claims more than this is taken for damaged, B. Writers end a chunk at
# some MB, or after the one message that is larger.
MOST_COMPRESSED_BYTES = 1 << 30
_PIECE_BYTES = 1 << 16
# A byte of lz4 stands for at most 255.
_LZ4_RATIO = 255

MESSAGE_HEAD = struct.Struct('<BQHIQQ')
"""What stands before a message's data: opcode, length, channel, sequence, log and publish time."""
_MESSAGE_FIELDS_BYTES = MESSAGE_HEAD.size - HEAD.size


def unpack(head: ChunkHead, stored: memoryview) -> memoryview:
    """Return the records in a chunk, checked against its size and checksum. Raises DamageError."""
    data = decompressed(head.compression, stored, head.size)
    if head.crc and zlib.crc32(data) != head.crc:
        raise DamageError('does not fit its checksum')
    return memoryview(data)


def decompressed(compression: str, stored: memoryview, size: int) -> bytes | memoryview:
    """Return the `size` bytes that were compressed as `stored`. Raises DamageError."""
    if not compression:
        data: bytes | memoryview = stored
    elif compression not in ('lz4', 'zstd'):
        raise DamageError(f'is compressed as {compression!r}; only lz4 and zstd are known')
    elif size > MOST_COMPRESSED_BYTES:
        raise DamageError(f'claims {size} bytes, more than any chunk has')
    else:
        try:
            data = _unlz4(stored, size) if compression == 'lz4' else unzstd(stored, size)
        except DamageError:
            raise
        except Exception as error:  # what these libraries raise has no common base
            raise DamageError(f'cannot be decompressed ({error})') from None
    if len(data) != size:
        raise DamageError(f'has {len(data)} bytes instead of {size}')
    return data


def unzstd(stored: memoryview, size: int | None = None) -> bytes:
    """Return what was compressed as zstd; `size` is its size, if the frame need not tell it."""
    import zstandard

    told = zstandard.get_frame_parameters(stored).content_size
    if told != zstandard.CONTENTSIZE_UNKNOWN and told != (told if size is None else size):
        raise DamageError(f'has {told} bytes instead of {size}')
    if told > MOST_COMPRESSED_BYTES and size is None:
        raise DamageError('tells no size, or one that nothing here has')
    return zstandard.ZstdDecompressor().decompress(
        stored, max_output_size=size or 0, allow_extra_data=False
    )


def _unlz4(stored: memoryview, size: int) -> bytes:
    import lz4.frame  # type: ignore[import-untyped,unused-ignore]

    told = lz4.frame.get_frame_info(stored)['content_size']
    if told not in (0, size) or size > _LZ4_RATIO * len(stored):
        raise DamageError(f'has another size than the {size} bytes it claims')
    data: bytes = lz4.frame.decompress(stored)
    return data


def decompressed_front(compression: str, stored: memoryview, most: int) -> bytes | memoryview:
    """Return what is left of data whose end is cut off or broken, at most some more than `most`."""
    if not compression:
        return stored
    front = bytearray()
    try:
        if compression == 'lz4':
            import lz4.frame

            step = lz4.frame.LZ4FrameDecompressor().decompress
        else:
            import zstandard

            step = zstandard.ZstdDecompressor().decompressobj().decompress
        for start in range(0, len(stored), _PIECE_BYTES):
            front += step(bytes(stored[start : start + _PIECE_BYTES]))
            if len(front) > most:
                break
    except Exception:  # what these libraries raise has no common base; the front stays good
        pass
    return bytes(front)


def split(data: memoryview, other: Callable[[int, memoryview], None]) -> list[Stored]:
    """Return the messages in `data`, a row of records; `other` gets opcode and body of the rest.

    Raises DamageError if the records do not fill `data` exactly.
    """
    found: list[Stored] = []
    at = split_front(data, other, found)
    if at != len(data):
        raise DamageError(f'holds a record at {at} that goes beyond its end')
    return found


def split_front(
    data: memoryview, other: Callable[[int, memoryview], None], found: list[Stored]
) -> int:
    """Add the messages in `data` to `found`, up to the first record that is not whole there.

    Return where that is; `len(data)` if all are. Raises DamageError for a message too short for its
    own fields.
    """
    at, end = 0, len(data)
    message, size, head_size = MESSAGE_HEAD.unpack_from, MESSAGE_HEAD.size, HEAD.size
    while end - at >= head_size:
        if end - at >= size:
            opcode, length, channel, _, time_ns, _ = message(data, at)
        else:
            opcode, length = HEAD.unpack_from(data, at)
        following = at + head_size + length
        if following > end:
            break
        if opcode != MESSAGE:
            other(opcode, data[at + head_size : following])
        elif length < _MESSAGE_FIELDS_BYTES:
            raise DamageError(f'holds a message at {at} of only {length} bytes')
        else:
            found.append((channel, time_ns, at + size, following))
        at = following
    return at
