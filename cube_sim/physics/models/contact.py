"""Model `contact`: rigid bodies in contact; its laws are the package `cube_sim.physics.contact`."""

CODE = 2
