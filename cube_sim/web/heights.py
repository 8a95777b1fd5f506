"""Heights: how high the last cubes are, over the last seconds."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from cube_sim.messages.markers import PALETTE

Floats = NDArray[np.float64]

# Simulated time that is shown, s, how many cubes, and how many points a second.
SPAN = 8.0
CUBES = 3
_RATE = 25.0


class Heights:
    """A plot on the panel of the heights of the last cubes, each in its colour."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the plot where the panel is being built."""
        self._samples: deque[tuple[float, int, Floats]] = deque()
        self._colors: tuple[int, ...] = ()
        self._plot = gui.add_uplot(
            data=tuple(np.zeros(1) for _ in range(1 + CUBES)),
            series=_series(()),
            scales={
                'x': uplot.Scale(time=False, range=(-SPAN, 0.0)),
                'y': uplot.Scale(range=(0.0, None)),
            },
            axes=(
                uplot.Axis(
                    label='simulated seconds before now',
                    labelSize=18,
                    size=36,
                    font='11px sans-serif',
                ),
                uplot.Axis(label='height, m', labelSize=18, size=44, font='11px sans-serif'),
            ),
            legend=uplot.Legend(show=False),
            height=170,
        )

    def clear(self) -> None:
        """Forget what has been noted."""
        self._samples.clear()

    def add(self, seconds: float, poses: NDArray[Any], count: int) -> None:
        """
        Take note of the last of `count` cubes at a simulated time, s; an earlier one starts anew.

        `poses` (M, 7) are theirs; M may be less than `count`, but not than CUBES.
        """
        if self._samples:
            since = seconds - self._samples[-1][0]
            if since < 0.0:
                self._samples.clear()
            elif since < 1.0 / _RATE:
                return
        self._samples.append((seconds, count, np.array(poses[-CUBES:, 2], np.float64)))
        while self._samples[0][0] < seconds - SPAN:
            self._samples.popleft()

    def draw(self) -> None:
        """Show what has been noted."""
        if not self._samples:
            return
        count = self._samples[-1][1]
        shown = list(range(max(0, count - CUBES), count))
        times = np.array([sample[0] for sample in self._samples])
        # A cube that is not there yet is on the ground: gaps confuse the plot.
        tracks = np.zeros((CUBES, len(times)))
        for at, (_, there, tops) in enumerate(self._samples):
            first = there - len(tops)
            for row, index in enumerate(shown):
                if first <= index < there:
                    tracks[row, at] = tops[index - first]
        if (colors := tuple(index % len(PALETTE) for index in shown)) != self._colors:
            self._colors = colors
            self._plot.series = _series(colors)
        # Seconds before now: the axis stands still.
        self._plot.data = (times - times[-1], *tracks)


def beside(gui: viser.GuiApi, keys: str) -> Heights:
    """Return a plot in a panel of its own, at the lower left; `keys` says what the keys do."""
    panel = gui.add_panel()
    with panel.add_tab('Heights'):
        heights = Heights(gui)
    with panel.add_tab('Keys'):
        gui.add_markdown(keys)
    panel.float(x=15, y=-15, width=300)
    return heights


def _series(colors: tuple[int, ...]) -> tuple[uplot.Series, ...]:
    tracks = []
    for row in range(CUBES):
        color = 'transparent'
        if row < len(colors):
            red, green, blue = (PALETTE[colors[row]][:3] * 255).astype(int)
            color = f'rgb({red},{green},{blue})'
        tracks.append(uplot.Series(label=f'cube {row}', stroke=color, width=1.6))
    return (uplot.Series(label='time'), *tracks)
