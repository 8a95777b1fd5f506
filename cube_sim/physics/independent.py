"""The engine of the models whose cubes do not touch each other."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics import step as layout
from cube_sim.physics.engine import NO_CONTACT_POINTS, ContactPoints
from cube_sim.physics.machine_code import STEP, MachineCode
from cube_sim.physics.settings import Settings

Floats = NDArray[np.float64]


class IndependentCubes:
    """Advances blocks of cubes by `step.advance`, in threads once there are many."""

    def __init__(self, model: int, threads: int) -> None:
        """Compute by the model of that code, in up to `threads` threads."""
        self._model = model
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self._codes = [MachineCode(STEP) for _ in range(threads)]
        self._scratch = np.empty((threads, layout.SCRATCH_ROWS, layout.BLOCK))
        for code, scratch in zip(self._codes, self._scratch, strict=True):
            code.set(scratch=scratch.ctypes.data, model=model)

    def use(self, state: Floats, settings: Settings) -> None:
        """Work on `state` (13, capacity) by `settings` from now on."""
        numbers = np.array(settings.constants())
        self._memory = state, numbers
        for code in self._codes:
            code.set(state=state.ctypes.data, capacity=state.shape[1], numbers=numbers.ctypes.data)

    def added(self, first: int, count: int) -> None:
        """Nothing is remembered of a cube."""

    def cleared(self) -> None:
        """Nothing is remembered of a cube."""

    def advance(self, count: int, steps: int) -> int:
        """Advance `count` cubes by `steps` steps; return how many contacts they had."""
        if self._pool is None or count <= layout.BLOCK:
            return self._share(0, 0, count, steps)
        blocks = -(-count // layout.BLOCK)
        shares = min(len(self._codes), blocks)
        bounds = [layout.BLOCK * (blocks * i // shares) for i in range(shares)] + [count]
        others = [
            self._pool.submit(self._share, i, bounds[i], bounds[i + 1], steps)
            for i in range(1, shares)
        ]
        contacts = self._share(0, bounds[0], bounds[1], steps)
        return contacts + sum(other.result() for other in others)

    def awake(self, count: int) -> int:
        """Return `count`: these models know no sleep."""
        return count

    def contact_points(self, count: int) -> ContactPoints:
        """Return none: these models keep no contacts after a step."""
        return NO_CONTACT_POINTS

    def counters(self) -> dict[str, int]:
        """Return nothing: the cost of a step does not vary."""
        return {}

    def _share(self, thread: int, first: int, last: int, steps: int) -> int:
        code = self._codes[thread]
        code.set(first=first, last=last, steps=steps)
        return code()
