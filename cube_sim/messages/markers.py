"""Markers on the wire: a CUBE for each cube, and the triangles of the ground."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.cdr import ENCAPSULATION, CdrWriter

Floats = NDArray[np.float64]

# From visualization_msgs/Marker.
_CUBE, _LINE_LIST, _TRIANGLE_LIST = 1, 5, 11
ADD, DELETE = 0, 2

NAMESPACE = 'cubes'

# The colours that the cubes take in turn, red green blue alpha.
PALETTE = np.array(
    [
        [0.90, 0.32, 0.24, 1.0],
        [0.20, 0.55, 0.85, 1.0],
        [0.96, 0.72, 0.20, 1.0],
        [0.30, 0.70, 0.45, 1.0],
        [0.60, 0.40, 0.75, 1.0],
        [0.25, 0.70, 0.72, 1.0],
        [0.92, 0.50, 0.65, 1.0],
        [0.55, 0.60, 0.66, 1.0],
    ],
    np.float32,
)


def cube_markers(
    time_ns: int, frame_id: str, poses: Floats, cube_size: float, removed: int = 0
) -> bytes:
    """
    Lay out a visualization_msgs/MarkerArray with one CUBE of side `cube_size` (m) for each pose.

    `poses` is (N, 7), m, in `frame_id`; the id of a marker is its row. The ids behind them, as
    many as were `removed`, get a DELETE each.
    """
    shown = len(poses)
    count = shown + removed
    head = ENCAPSULATION + count.to_bytes(4, 'little')
    if count == 0:
        return head
    layout = _layout(frame_id)
    pairs = _standing_cubes(frame_id, shown, removed, cube_size).copy().view(layout.dtype)
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    for odd in (0, 1):
        own = pairs[: (count - odd + 1) // 2]
        own[f'sec{odd}'] = seconds
        own[f'nanosec{odd}'] = nanoseconds
        own[f'pose{odd}'][: (shown - odd + 1) // 2] = poses[odd::2]
    # The last marker has no padding behind it, and an odd count leaves half a pair.
    end = (count - 1) // 2 * layout.dtype.itemsize + layout.ends[(count - 1) % 2]
    return b''.join((head, pairs.view(np.uint8).data[:end]))


@functools.lru_cache(maxsize=2)
def _standing_cubes(frame_id: str, shown: int, removed: int, cube_size: float) -> NDArray[np.uint8]:
    """Return the memory of the markers with all that does not move filled in."""
    layout = _layout(frame_id)
    count = shown + removed
    memory = np.tile(layout.pair, -(-count // 2))
    pairs = memory.view(layout.dtype)
    for odd in (0, 1):
        own = pairs[: (count - odd + 1) // 2]
        ids = np.arange(odd, count, 2)
        own[f'id{odd}'] = ids
        own[f'action{odd}'] = np.where(ids < shown, ADD, DELETE)
        own[f'scale{odd}'] = cube_size
        own[f'color{odd}'] = PALETTE[ids % len(PALETTE)]
    return memory


@dataclass(frozen=True)
class _Layout:
    """Two markers that follow each other: their bytes, their fields, and where each ends."""

    pair: NDArray[np.uint8]
    dtype: np.dtype[np.void]
    ends: tuple[int, int]


@functools.lru_cache(maxsize=4)
def _layout(frame_id: str) -> _Layout:
    """
    Lay out two blank markers.

    Where a float64 of a marker lies depends on whether the marker starts at a multiple of
    eight. Any two that follow each other fill a whole number of eights, so every pair is alike.
    """
    cdr = CdrWriter()
    cdr.uint32(2)
    start = len(cdr)
    fields: list[tuple[str, str | tuple[str, int], int]] = []
    ends = []
    for odd in (0, 1):
        for name, kind, place in _write_cube(cdr, frame_id):
            fields.append((f'{name}{odd}', kind, place - start))
        ends.append(len(cdr) - start)
    cdr.align(4)
    size = len(cdr) - start
    dtype: np.dtype[np.void] = np.dtype(
        {
            'names': [name for name, _, _ in fields],
            'formats': [kind for _, kind, _ in fields],
            'offsets': [place for _, _, place in fields],
            'itemsize': size,
        }
    )
    pair = np.frombuffer(cdr.message()[start:], np.uint8)
    return _Layout(pair, dtype, (ends[0], ends[1]))


def _write_cube(cdr: CdrWriter, frame_id: str) -> list[tuple[str, str | tuple[str, int], int]]:
    """Write a CUBE whose varying fields are blank; return name, type and place of each."""
    fields: list[tuple[str, str | tuple[str, int], int]] = []
    cdr.align(4)
    fields.append(('sec', '<i4', len(cdr)))
    fields.append(('nanosec', '<u4', len(cdr) + 4))
    cdr.header(0, frame_id)
    cdr.string(NAMESPACE)
    cdr.align(4)
    fields.append(('id', '<i4', len(cdr)))
    cdr.int32(0)
    cdr.int32(_CUBE)
    fields.append(('action', '<i4', len(cdr)))
    cdr.int32(ADD)
    cdr.align(8)
    fields.append(('pose', ('<f8', 7), len(cdr)))
    cdr.float64s(*[0.0] * 7)
    fields.append(('scale', ('<f8', 3), len(cdr)))
    cdr.float64s(*[0.0] * 3)
    fields.append(('color', ('<f4', 4), len(cdr)))
    cdr.float32s(*[0.0] * 4)
    _write_rest(cdr, np.empty((0, 3)), np.empty((0, 4)))
    return fields


def _write_rest(cdr: CdrWriter, points: Floats, colors: Floats) -> None:
    """Write what follows a marker's colour: lifetime for ever, points, no texture, no mesh."""
    cdr.stamp(0)
    cdr.uint8(0)  # frame_locked
    cdr.uint32(len(points))
    if len(points):
        cdr.align(8)
        cdr.raw(np.ascontiguousarray(points, '<f8').data.cast('B'))
    cdr.uint32(len(colors))
    cdr.raw(np.ascontiguousarray(colors, '<f4').tobytes())
    cdr.string('')  # texture_resource
    cdr.header(0, '')  # texture
    cdr.string('')  # texture.format
    cdr.uint32(0)  # texture.data
    cdr.uint32(0)  # uv_coordinates
    cdr.string('')  # text
    cdr.string('')  # mesh_resource
    cdr.string('')  # mesh_file.filename
    cdr.uint32(0)  # mesh_file.data
    cdr.uint8(0)  # mesh_use_embedded_materials


def contact_lines(
    time_ns: int, frame_id: str, positions: Floats, normals: Floats, cube_size: float
) -> bytes:
    """
    Lay out a visualization_msgs/Marker of type LINE_LIST: a line for each contact point.

    `positions` (K, 3), m, in `frame_id`; `normals` (K, 3), unit vectors. Line k goes from point
    2 k, where the cubes touch, half a `cube_size` (m) along the normal to point 2 k + 1. Without
    contacts the marker is a DELETE, as RViz calls a list without points an error.
    """
    ends = positions + 0.5 * cube_size * normals
    points = np.stack([positions, ends], axis=1).reshape(-1, 3)
    cdr = CdrWriter()
    cdr.header(time_ns, frame_id)
    cdr.string('contacts')
    cdr.int32(0)
    cdr.int32(_LINE_LIST)
    cdr.int32(ADD if len(points) else DELETE)
    cdr.float64s(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    cdr.float64s(0.02 * cube_size, 0.0, 0.0)  # of a line only x counts, its width
    cdr.float32s(1.0, 0.85, 0.1, 1.0)
    _write_rest(cdr, points, np.empty((0, 4)))
    return cdr.message()


def triangle_list(
    time_ns: int, frame_id: str, namespace: str, points: Floats, colors: Floats
) -> bytes:
    """
    Lay out a visualization_msgs/Marker of type TRIANGLE_LIST with id 0.

    `points` (3 T, 3) are the corners of T triangles, m, in `frame_id`; `colors` (3 T, 4) their
    red green blue alpha.
    """
    cdr = CdrWriter()
    cdr.header(time_ns, frame_id)
    cdr.string(namespace)
    cdr.int32(0)
    cdr.int32(_TRIANGLE_LIST)
    cdr.int32(ADD)
    cdr.float64s(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    cdr.float64s(1.0, 1.0, 1.0)
    cdr.float32s(1.0, 1.0, 1.0, 1.0)
    _write_rest(cdr, points, colors)
    return cdr.message()
