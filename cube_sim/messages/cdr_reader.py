"""CDR read field by field, in either byte order, never beyond the message's end."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.errors import MessageError

Floats = NDArray[np.float64]
Data = bytes | bytearray | memoryview

_ENCAPSULATION_BYTES = 4
# Behind the last field a sender may pad its message to a multiple of four.
_PADDING_BYTES = 3
_SECOND = 1_000_000_000


class CdrReader:
    """One message, read in the order of its definition; `kind` names it in errors."""

    def __init__(self, data: Data, kind: str) -> None:
        """Raise MessageError unless `data` starts as plain CDR, of version 1 as ROS 2 uses it."""
        self._data = memoryview(data).cast('B')
        self._kind = kind
        self._at = _ENCAPSULATION_BYTES
        if len(self._data) < _ENCAPSULATION_BYTES:
            raise self.error(f'has {len(self._data)} bytes, fewer than the encapsulation alone')
        if self._data[0] != 0 or self._data[1] > 1:
            raise self.error(f'has the encapsulation {self._data[:2].hex()}, not 0000 or 0001')
        self.order = '<' if self._data[1] else '>'

    def error(self, what: str) -> MessageError:
        """Return the error that says `what` of this message."""
        return MessageError(
            f'These {len(self._data)} bytes are no {self._kind}: the message {what}; check the '
            'type of its topic, or where the bytes come from.'
        )

    def uint8(self) -> int:
        """Read a uint8, byte or bool."""
        return self._data[self._take(1, 1)]

    def uint32(self) -> int:
        """Read a uint32."""
        return self._number('I', 4)

    def int32(self) -> int:
        """Read an int32."""
        return self._number('i', 4)

    def int64(self) -> int:
        """Read an int64."""
        return self._number('q', 8)

    def float64(self) -> float:
        """Read a float64."""
        value: float = struct.unpack_from(self.order + 'd', self._data, self._take(8, 8))[0]
        return value

    def float64s(self, count: int) -> Floats:
        """Read `count` float64 that follow each other: on the message's own memory, if aligned."""
        # An empty sequence has no padding before it.
        start = self._take(8, 8 * count) if count else self._at
        return floats_at(self._data, start, count, self.order)

    def int64s(self, count: int) -> list[int]:
        """Read `count` int64 that follow each other."""
        if count == 0:
            return []
        start = self._take(8, 8 * count)
        return list(struct.unpack_from(f'{self.order}{count}q', self._data, start))

    def raw(self, count: int) -> bytes:
        """Read `count` bytes."""
        start = self._take(1, count)
        return bytes(self._data[start : start + count])

    def string(self) -> str:
        """Read a string."""
        length = self.uint32()
        if length == 0:  # not as it should be, but some senders' empty string
            return ''
        encoded = self.raw(length)
        if encoded[-1] != 0:
            raise self.error('has a string without its closing zero')
        try:
            return encoded[:-1].decode()
        except UnicodeDecodeError:
            raise self.error('has a string that is not UTF-8') from None

    def count(self, least: int) -> int:
        """Read the length of a sequence whose items take at least `least` bytes each."""
        count = self.uint32()
        if count * least > len(self._data) - self._at:
            raise self.error(f'claims {count} items, for which it is too short')
        return count

    def stamp(self) -> int:
        """Read a builtin_interfaces/Time, ns."""
        seconds, nanoseconds = self.int32(), self.uint32()
        if nanoseconds >= _SECOND:
            raise self.error(f'has {nanoseconds} ns beside its seconds, a second or more')
        return seconds * _SECOND + nanoseconds

    def header(self) -> tuple[int, str]:
        """Read a std_msgs/Header: time, ns, and frame_id."""
        return self.stamp(), self.string()

    def end(self) -> None:
        """Raise MessageError unless everything is read."""
        if len(self._data) - self._at > _PADDING_BYTES:
            raise self.error(f'should end after {self._at} bytes')

    def _number(self, letter: str, size: int) -> int:
        value: int = struct.unpack_from(self.order + letter, self._data, self._take(size, size))[0]
        return value

    def _take(self, alignment: int, size: int) -> int:
        """Step over `size` bytes behind the padding; return where they start."""
        start = self._at + (_ENCAPSULATION_BYTES - self._at) % alignment
        if size > len(self._data) - start:
            raise self.error('ends too early')
        self._at = start + size
        return start


def floats_at(data: Data, start: int, count: int, order: str = '<') -> Floats:
    """
    Return `count` float64 of `data` as numpy's own, read-only.

    They are a view if they lie at a multiple of eight in this machine's memory and byte order,
    as they do in a message that stands alone, and a copy otherwise.
    """
    floats: Floats = np.empty(0)
    if count:  # frombuffer refuses none at the message's end
        floats = np.frombuffer(data, f'{order}f8', count, start)
        if not (floats.flags.aligned and floats.dtype.isnative):
            floats = floats.astype(np.float64)
    floats.flags.writeable = False
    return floats
