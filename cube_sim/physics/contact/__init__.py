"""
Model `contact`: rigid cubes that touch the plane z = 0 and each other.

A cube that no other cube is near moves from event to event (`alone`): exact flight, the instant of
an impact, the impact of all touching corners at once, support. Cubes that touch share sub-steps of
sequential impulses (`solver`). What lies still sleeps (`sleep`).
"""
