"""
The simulator as another process sees it: what the keyboard and the page stand on.

    serving   Serving: a node whose callbacks run on a thread of their own
    status    Status: what /diagnostics says of a simulator
    link      SimulatorLink: its services, parameters and camera, whether it answers or not
"""

from cube_sim.remote.link import Answer, SimulatorLink
from cube_sim.remote.serving import Serving
from cube_sim.remote.status import Status

__all__ = ['Answer', 'Serving', 'SimulatorLink', 'Status']
