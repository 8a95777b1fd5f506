"""Entries of machine code as plain Python: the same calls, and CPython rounds each operation."""

from __future__ import annotations

import ctypes
import importlib
import math
from types import SimpleNamespace

import numpy as np

from cube_sim.physics.machine_code import Entry


class PlainCode:
    """Takes the place of MachineCode: the function that it is compiled from, as it is written."""

    def __init__(self, entry: Entry) -> None:
        module, _, maker = entry.make.partition(':')
        # Of numba's types only this is asked for: which arguments point to what.
        types = SimpleNamespace(
            float64=ctypes.c_double, int64=_Int64, CPointer=lambda number: number
        )
        kinds, self._function = getattr(importlib.import_module(module), maker)(types, _array)
        self._kinds = kinds[: len(entry.addresses)]
        self._names = (*entry.addresses, *entry.numbers)
        self._arguments = dict.fromkeys(self._names, 0)

    def set(self, **arguments: int) -> None:
        self._arguments.update(arguments)

    def __call__(self) -> int:
        values = [self._arguments[name] for name in self._names]
        count = len(self._kinds)
        pointers = list(zip(values[:count], self._kinds, strict=True))
        return int(self._function(*pointers, *values[count:]))


class _Int64(ctypes.c_int64):
    """numba's int64: called with the types of the arguments, it makes a signature."""

    def __new__(cls, *kinds):
        return kinds


def _array(pointer: tuple[int, type], shape) -> np.ndarray:
    """The array at an address, as numba's carray gives it."""
    address, kind = pointer
    shape = shape if isinstance(shape, tuple) else (shape,)
    number = ctypes.c_double if kind is ctypes.c_double else ctypes.c_int64
    memory = (number * math.prod(shape)).from_address(address)
    return np.frombuffer(memory, np.float64 if kind is ctypes.c_double else np.int64).reshape(shape)
