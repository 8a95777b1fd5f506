"""What a person at a terminal sees of a run."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TextIO

from cube_sim.node.diagnostics import achieved_factor
from cube_sim.simulation.runner import Progress
from cube_sim.simulation.simulation import Simulation


def banner(name: str, simulation: Simulation, bag: Path | None) -> str:
    """Return how to use the node called `name`: throws, topics, and where the bag goes."""
    settings = simulation.world.settings
    head = (
        f'cube_sim runs: model {settings.model}, steps of {settings.time_step * 1e3:g} ms, '
        f'{1e9 / simulation.period_ns:g} publications a second'
    )
    none = f'none; ros2 service call {name}/record std_srvs/srv/SetBool "{{data: true}}"'
    lines = [
        head,
        '',
        f'  throw a cube      ros2 service call {name}/throw std_srvs/srv/Trigger',
        f'    without ros2    {_python()} -m cube_sim.node.throw',
        f'  switch the model  ros2 service call {name}/next_model std_srvs/srv/Trigger',
        f'  look at           {name}/poses  {name}/markers  {name}/throws  {name}/settings',
        f'  bag               {bag or none}',
        '  end               Ctrl-C',
        '',
    ]
    return '\n'.join(lines)


def _python() -> str:
    """Return the shortest name of the Python that runs this."""
    return min((sys.executable, os.path.relpath(sys.executable)), key=len)


class LiveLine:
    """One line that is written over again in a terminal, or a line a second elsewhere."""

    def __init__(self, simulation: Simulation, progress: Progress, out: TextIO) -> None:
        """Show `simulation` on `out`, beginning at `progress`."""
        self._simulation = simulation
        self._before = progress
        self._out = out
        self._terminal = out.isatty()
        self.period = 0.25 if self._terminal else 1.0

    @classmethod
    def on_stdout(cls, simulation: Simulation, progress: Progress) -> LiveLine:
        """Show it where `print` prints."""
        return cls(simulation, progress, sys.stdout)

    def show(self, now: Progress, note: str = '') -> None:
        """Write the state at `now`."""
        world = self._simulation.world
        factor = achieved_factor(self._before, now)
        self._before = now
        text = (
            f't {now.sim_ns / 1e9:9.2f} s   cubes {len(world):5d}   '
            f'model {world.settings.model:8s}   real-time factor {factor:6.2f}{note}'
        )
        self._out.write(f'\r\x1b[2K{text}' if self._terminal else f'{text}\n')
        self._out.flush()

    def close(self) -> None:
        """Leave the line."""
        if self._terminal:
            self._out.write('\n')
            self._out.flush()
