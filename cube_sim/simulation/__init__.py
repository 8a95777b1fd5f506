"""
A run: the world, the camera that throws, and what happens when.

Knows the physics and the layout of messages, and names topics; no ROS library. The node is one
face of it: anything that takes bytes can be another (`Outlet`).
"""

from cube_sim.simulation.scenario import Scenario, ScenarioError
from cube_sim.simulation.simulation import Outlet, Simulation
from cube_sim.simulation.throwing import Throwing

__all__ = ['Outlet', 'Scenario', 'ScenarioError', 'Simulation', 'Throwing']
