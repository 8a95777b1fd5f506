"""How the chunks of a file are compressed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

from cube_sim.recording.errors import RecordingError

Compression = Literal['none', 'lz4', 'zstd']


def find_compressor(compression: str) -> Callable[[bytes], bytes]:
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
