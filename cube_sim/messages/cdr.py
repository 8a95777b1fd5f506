"""CDR, the OMG's Common Data Representation, as ROS 2 uses it: little-endian, plain."""

from __future__ import annotations

import struct

# The encapsulation that stands before every message; alignment counts from its end.
ENCAPSULATION = b'\x00\x01\x00\x00'


class CdrWriter:
    """One message being laid out, field after field in the order of its definition."""

    def __init__(self) -> None:
        """Start with the encapsulation."""
        self._buffer = bytearray(ENCAPSULATION)

    def __len__(self) -> int:
        """Return the bytes so far, the encapsulation included."""
        return len(self._buffer)

    def align(self, size: int) -> None:
        """Pad with zeros to a multiple of `size` bytes after the encapsulation."""
        self._buffer += bytes(-(len(self._buffer) - len(ENCAPSULATION)) % size)

    def uint8(self, value: int) -> None:
        """Write a uint8, byte or bool."""
        self._buffer.append(value)

    def int32(self, value: int) -> None:
        """Write an int32."""
        self.align(4)
        self._buffer += struct.pack('<i', value)

    def uint32(self, value: int) -> None:
        """Write a uint32, or the length of a sequence."""
        self.align(4)
        self._buffer += struct.pack('<I', value)

    def int64(self, value: int) -> None:
        """Write an int64."""
        self.align(8)
        self._buffer += struct.pack('<q', value)

    def float32s(self, *values: float) -> None:
        """Write float32 numbers that follow each other."""
        self.align(4)
        self._buffer += struct.pack(f'<{len(values)}f', *values)

    def float64s(self, *values: float) -> None:
        """Write float64 numbers that follow each other."""
        self.align(8)
        self._buffer += struct.pack(f'<{len(values)}d', *values)

    def string(self, text: str) -> None:
        """Write a string: its length with the closing zero, then its UTF-8 bytes."""
        encoded = text.encode() + b'\x00'
        self.uint32(len(encoded))
        self._buffer += encoded

    def raw(self, content: bytes | memoryview) -> None:
        """Write bytes that are laid out already."""
        self._buffer += content

    def stamp(self, time_ns: int) -> None:
        """Write a builtin_interfaces/Time or Duration."""
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        self.int32(seconds)
        self.uint32(nanoseconds)

    def header(self, time_ns: int, frame_id: str) -> None:
        """Write a std_msgs/Header."""
        self.stamp(time_ns)
        self.string(frame_id)

    def message(self) -> bytes:
        """Return the message."""
        return bytes(self._buffer)
