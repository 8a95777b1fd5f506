"""Files and messages that rosbag2 compressed as a whole, with zstd."""

from __future__ import annotations

from pathlib import Path

from cube_sim.recording.chunk_content import unzstd
from cube_sim.recording.mcap_records import DamageError

_PIECE_BYTES = 1 << 20


def unpack_file(file: Path, directory: Path) -> Path:
    """Unpack `file` into `directory`, piece by piece; return the new file.

    Raises DamageError, and OSError if there is no room.
    """
    target = directory / f'{len(list(directory.iterdir()))}.mcap'
    if not unpack_front(file, target):
        raise DamageError('its compressed data end too early or are broken')
    return target


def unpack_front(file: Path, target: Path) -> bool:
    """Unpack what can be had of `file` into `target`; say whether that is all. Raises OSError."""
    import zstandard

    unpacker = zstandard.ZstdDecompressor().decompressobj()
    with file.open('rb') as stream, target.open('wb') as out:
        while piece := stream.read(_PIECE_BYTES):
            while piece:
                if unpacker.eof:  # one file may be several frames, one after the other
                    unpacker = zstandard.ZstdDecompressor().decompressobj()
                try:
                    out.write(unpacker.decompress(piece))
                except zstandard.ZstdError:
                    return False
                piece = unpacker.unused_data if unpacker.eof else b''
    return bool(unpacker.eof)


def unpack_message(data: memoryview) -> bytes:
    """Return a message that was compressed alone. Raises DamageError."""
    try:
        return unzstd(data)
    except DamageError:
        raise
    except Exception as error:  # the library's errors, and MemoryError for what none can hold
        raise DamageError(f'a message cannot be decompressed ({error})') from None
