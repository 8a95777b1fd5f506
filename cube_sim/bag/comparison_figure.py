"""The figure of `cube_bag compare`: two runs side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.comparison import Comparison, poses
from cube_sim.analysis.timeline import pose_topic
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

Floats = NDArray[np.float64]

# More lines than this say nothing more to the eye.
CUBES = 12


def draw_comparison(
    path: Path,
    readers: tuple[BagReader, BagReader],
    topics: tuple[str | None, str | None],
    result: Comparison,
) -> None:
    """Draw the heights of the first cubes in both runs, and the distance between them."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise RecordingError(
            'Figures need matplotlib: install it with pip install matplotlib.'
        ) from None
    figure = Figure(figsize=(11, 6.5), layout='constrained')
    axes = figure.subplot_mosaic([['first', 'second'], ['apart', 'apart']])
    axes['second'].sharex(axes['first'])
    axes['second'].sharey(axes['first'])
    for name, reader, topic in zip(('first', 'second'), readers, topics, strict=True):
        axis = axes[name]
        for cube, (times, heights) in enumerate(_heights(reader, topic)):
            axis.plot(times, heights, color=f'C{cube % 10}', linewidth=1.2)
        axis.set(title=reader.path.name, xlabel='time, s', ylabel='height of the centre, m')
        axis.grid(alpha=0.3)
    apart = axes['apart']
    times = np.array(result.times_ns) / 1e9
    # A logarithm has no place for zero: what is equal is not drawn.
    apart.plot(times, _positive(result.largest), color='C3', label='the farthest cube')
    apart.plot(times, _positive(result.mean), color='C0', label='mean of the cubes')
    apart.set(xlabel='time, s', ylabel='distance between the runs, m', yscale='log')
    apart.grid(alpha=0.3)
    apart.legend(loc='lower right')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=130)
    except (OSError, ValueError) as error:
        raise RecordingError(f'{path} cannot be written: {error}') from None


def _heights(reader: BagReader, topic: str | None) -> Sequence[tuple[Floats, Floats]]:
    lines: list[tuple[list[float], list[float]]] = [([], []) for _ in range(CUBES)]
    for time_ns, array in poses(reader, pose_topic(reader, topic)):
        for (times, heights), height in zip(lines, array[:CUBES, 2], strict=False):
            times.append(time_ns / 1e9)
            heights.append(float(height))
    return [(np.array(times), np.array(heights)) for times, heights in lines if times]


def _positive(values: Sequence[float]) -> Floats:
    array = np.array(values, np.float64)
    return np.where(array > 0.0, array, np.nan)
