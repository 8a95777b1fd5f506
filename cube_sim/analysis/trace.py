"""The course of a run in as many frames as fit: what figures are drawn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

# Columns of a frame's cubes.
X, Y, Z, VZ, POTENTIAL, TRANSLATION, ROTATION = range(7)

# Numbers that the frames of a trace may hold together (4 bytes each), and the frames of one.
NUMBERS = 4_000_000
FRAMES = 4_000


@dataclass(frozen=True)
class Frame:
    """One moment: the sums of the energies (3,), J, and X ... ROTATION of each cube (N, 7)."""

    time_ns: int
    generation: int
    energies: Floats
    cubes: Singles


class Trace:
    """
    Frames of a run at even distances, ever fewer the longer it gets.

    When the memory is used up every second frame is given up, and from then on only every
    second one is kept.
    """

    def __init__(self) -> None:
        """Begin without frames."""
        self.frames: list[Frame] = []
        self._stride = 1
        self._offered = 0
        self._numbers = 0

    def offer(
        self, time_ns: int, generation: int, poses: Floats, velocities: Floats, energies: Floats
    ) -> None:
        """Take a moment, or not: poses (N, 7), velocities (N, 6), energies (N, 3)."""
        offered = self._offered
        self._offered += 1
        if offered % self._stride:
            return
        cubes = np.empty((len(poses), 7), np.float32)
        cubes[:, :3] = poses[:, :3]
        cubes[:, VZ] = velocities[:, 2]
        cubes[:, POTENTIAL:] = energies
        # A cube whose velocity is not known does not make the sum unknown.
        self.frames.append(Frame(time_ns, generation, np.nansum(energies, axis=0), cubes))
        self._numbers += cubes.size
        while len(self.frames) > 1 and (self._numbers > NUMBERS or len(self.frames) > FRAMES):
            self.frames = self.frames[::2]
            self._stride *= 2
            self._numbers = sum(frame.cubes.size for frame in self.frames)

    def generations(self) -> list[list[Frame]]:
        """Return the frames, apart for the cubes between two resets."""
        apart: dict[int, list[Frame]] = {}
        for frame in self.frames:
            apart.setdefault(frame.generation, []).append(frame)
        return list(apart.values())
