"""The one way in which this room compiles a function."""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

from numba import config, njit

Function = TypeVar('Function', bound=Callable[..., object])


def jit(function: Function) -> Function:
    """
    Compile `function` to IEEE-754 arithmetic, cached on disk, running without the GIL.

    No fast-math and no contraction: every + - * / and square root is rounded on its own, so
    the same inputs give the same bits on every machine.
    """
    previous: str = getattr(config, 'CACHE_DIR', '')
    setattr(config, 'CACHE_DIR', previous or _cache_directory())
    try:
        return cast(Function, njit(cache=True, nogil=True, error_model='numpy')(function))
    finally:
        setattr(config, 'CACHE_DIR', previous)


@functools.lru_cache(maxsize=1)
def _cache_directory() -> str:
    """
    Name the directory of the compiled code, one for each state of this room's sources.

    numba looks only at the file that holds a cached function, not at the files of what it
    calls: without this, a change in one model would go on running as it was before.
    """
    room = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(room.rglob('*.py')):
        digest.update(source.read_bytes())
    beside = room / '__pycache__'
    if os.access(beside if beside.is_dir() else room, os.W_OK):
        parent = beside
    else:
        parent = Path(os.environ.get('XDG_CACHE_HOME') or '~/.cache').expanduser() / 'cube_sim'
    return str(parent / f'compiled-{digest.hexdigest()[:16]}')
