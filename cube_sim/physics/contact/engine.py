"""The engine of the model `contact`: its memory, and the machine code that works on it."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.contact import layout
from cube_sim.physics.contact.points import contact_points, joined, sleeping_points
from cube_sim.physics.contact.rules import rules_of
from cube_sim.physics.engine import NO_CONTACT_POINTS, ContactPoints
from cube_sim.physics.machine_code import CONTACT, MachineCode
from cube_sim.physics.settings import Settings

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Array = TypeVar('Array', NDArray[np.float64], NDArray[np.int64])


class TouchingCubes:
    """Advances cubes that touch the plane and each other; remembers contacts and sleep."""

    def __init__(self) -> None:
        """Make the memory of an empty world."""
        self._code = MachineCode(CONTACT)
        self._settings: Settings | None = None
        self._counters = np.zeros(layout.COUNTERS, np.int64)
        self._scratch = np.zeros((layout.SCRATCH_ROWS, layout.SCRATCH_COLUMNS))
        self._cubes: Floats = np.zeros((1, layout.CUBE_COLUMNS))
        self._marks: Integers = np.zeros((1, layout.MARK_COLUMNS), np.int64)
        self._pair_capacity = 0
        self._pairs: Floats = np.zeros((0, layout.PAIR_COLUMNS))
        self._due: Floats = np.zeros(0)
        self._ends: Integers = np.zeros((0, layout.END_COLUMNS), np.int64)
        self._bodies: Floats = np.zeros((1, layout.BODY_COLUMNS))
        self._blocks: Floats = np.zeros((0, layout.BLOCK_SIZE))
        self._lanes: Integers = np.zeros((0, layout.LANE_COLUMNS), np.int64)
        self._work = _aligned(1, layout.WORK_SIZE)[0]
        self._sites = np.zeros(2, np.int64)
        self._code.set(
            counters=self._counters.ctypes.data,
            scratch=self._scratch.ctypes.data,
            work=self._work.ctypes.data,
        )

    def use(self, state: Floats, settings: Settings) -> None:
        """Work on `state` (13, capacity) by `settings` from now on; a change of these wakes all."""
        self._state = state
        self._reserve(state.shape[1])
        if settings != self._settings:
            self._settings = settings
            self._numbers = np.array(rules_of(settings))
            self._wake()
        self._set_addresses()

    def added(self, first: int, count: int) -> None:
        """Take note that the cubes `first` to `count` - 1 are new."""
        self._reserve(count)
        self._cubes[first:count] = 0.0
        self._marks[first:count] = 0
        self._counters[layout.STALE] = 1

    def cleared(self) -> None:
        """Take note that all cubes are gone."""
        self._counters[:] = 0
        self._counters[layout.STALE] = 1
        self._scratch[:] = 0.0
        self._marks[:] = 0
        self._ends[:] = 0

    def advance(self, count: int, steps: int) -> int:
        """Advance `count` cubes by `steps` steps; return how many contacts they had."""
        self._counters[layout.CONTACTS] = 0
        while steps:
            self._code.set(count=count, steps=steps)
            done = self._code()
            steps -= done
            if steps:
                self._reserve_pairs(2 * self._pair_capacity + 1024)
        return int(self._counters[layout.CONTACTS])

    def awake(self, count: int) -> int:
        """Return how many of `count` cubes are not asleep."""
        return count - int(np.count_nonzero(self._marks[:count, layout.ASLEEP]))

    def contact_points(self, count: int) -> ContactPoints:
        """Return where the cubes touched in the last step."""
        assert self._settings is not None
        awake = contact_points(
            self._state[:, :count],
            self._cubes,
            self._blocks,
            self._lanes,
            int(self._counters[layout.BLOCKS]),
            len(self._marks) - 1,
            0.5 * self._settings.cube_size,
        )
        return joined([awake, self._sleeping_points()])

    def _sleeping_points(self) -> ContactPoints:
        substep = self._scratch[layout.MEMORY, 0]
        if substep == 0.0:  # none have touched yet
            return NO_CONTACT_POINTS
        first = layout.LIST_B if self._counters[layout.WHICH] else layout.LIST_A
        listed = self._ends[: self._counters[layout.PAIRS], first : first + 3]
        asleep = self._marks[:, layout.ASLEEP]
        near = listed[(asleep[listed[:, 0]] & asleep[listed[:, 1]]) == 1][:, [2, 0, 1]]
        if not len(near) or self._counters[layout.STALE]:
            return NO_CONTACT_POINTS
        share = self._numbers[0] / substep
        counts = self._ends[near[:, 0], layout.POINTS]
        return sleeping_points(self._state, self._pairs, near, counts, share)

    def counters(self) -> dict[str, int]:
        """Return what the last step took."""
        return {
            'touching_pairs': int(self._counters[layout.ACTIVES]),
            'near_pairs': int(self._counters[layout.PAIRS]),
            'parts': int(self._counters[layout.PARTS]),
            'impacts': int(self._counters[layout.IMPACTS]),
            'sweeps': int(self._counters[layout.SWEEPS]),
        }

    def _wake(self) -> None:
        self._marks[:, layout.ASLEEP] = 0
        self._marks[:, layout.AT_REST] = 0
        self._cubes[:, layout.STILL] = 0.0
        self._counters[layout.STALE] = 1

    def _reserve(self, count: int) -> None:
        """Make room for `count` cubes and the ground, in the last row."""
        if count >= len(self._cubes):
            self._cubes = _grown(self._cubes, count + 1)
            self._marks = _grown(self._marks, count + 1)
            self._bodies = _aligned(count + 1, layout.BODY_COLUMNS)
            self._sites = np.zeros(4 << (count - 1).bit_length(), np.int64)
            self._reserve_pairs(max(self._pair_capacity, 4 * count))

    def _reserve_pairs(self, pair_capacity: int) -> None:
        rows = pair_capacity + len(self._cubes) - 1
        self._pairs = _grown(self._pairs, rows)
        self._due = _grown(self._due, rows)
        self._ends = _grown(self._ends, rows)
        self._pair_capacity = pair_capacity
        # What is not used of this memory is never touched.
        blocks = layout.block_capacity(rows)
        self._blocks = _aligned(blocks, layout.BLOCK_SIZE)
        self._lanes = np.zeros((blocks, layout.LANE_COLUMNS), np.int64)
        self._counters[layout.BLOCKS] = 0
        if hasattr(self, '_numbers'):
            self._set_addresses()

    def _set_addresses(self) -> None:
        self._code.set(
            state=self._state.ctypes.data,
            capacity=len(self._cubes) - 1,
            numbers=self._numbers.ctypes.data,
            cubes=self._cubes.ctypes.data,
            marks=self._marks.ctypes.data,
            pairs=self._pairs.ctypes.data,
            due=self._due.ctypes.data,
            pair_capacity=self._pair_capacity,
            ends=self._ends.ctypes.data,
            bodies=self._bodies.ctypes.data,
            blocks=self._blocks.ctypes.data,
            block_capacity=len(self._blocks),
            lanes=self._lanes.ctypes.data,
            sites=self._sites.ctypes.data,
            site_capacity=len(self._sites),
        )


def _grown(array: Array, rows: int) -> Array:
    """Return `array` with at least `rows` rows, the new ones zero."""
    grown = np.zeros((max(rows, len(array)), *array.shape[1:]), array.dtype)
    grown[: len(array)] = array
    return grown


def _aligned(rows: int, columns: int) -> Floats:
    """Return zeros that begin at a cache line: a vector that lies across two costs twice."""
    memory = np.zeros(rows * columns + 8)
    first = -memory.ctypes.data % 64 // 8
    return memory[first : first + rows * columns].reshape(rows, columns)
