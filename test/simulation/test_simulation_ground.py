"""The height map that marks the plane."""

from __future__ import annotations

import hashlib

import numpy as np

from cube_sim.simulation.ground import (
    CELL_SIZE,
    CELLS,
    HILL_HEIGHT,
    VALLEY_RADIUS,
    ground_height,
    ground_triangles,
)

GOLDEN = '1606abf94170c7dd6894ae6019be0359bf79828bd4d0ade7de5bcda853a0473e'


def test_the_ground_is_the_same_bits_everywhere():
    # Only + - * / and roots: a golden hash, not a tolerance.
    points, colors = ground_triangles()
    content = points.astype('<f8').tobytes() + colors.astype('<f8').tobytes()
    assert hashlib.sha256(content).hexdigest() == GOLDEN


def test_the_ground_is_a_closed_square_of_triangles_that_face_up():
    points, colors = ground_triangles()
    triangles = points.reshape(-1, 3, 3)
    assert len(triangles) == 2 * CELLS**2
    assert colors.shape == (len(points), 4)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (normals[:, 2] > 0).all()
    # Seen from above they cover the square once: areas of CELL_SIZE^2 / 2 each, all exact.
    assert (normals[:, 2] == CELL_SIZE**2).all()
    half = CELLS * CELL_SIZE / 2
    assert points[:, :2].min() == -half
    assert points[:, :2].max() == half
    assert len(np.unique(points[:, :2], axis=0)) == (CELLS + 1) ** 2


def test_the_valley_floor_is_the_plane_and_nothing_is_below_it():
    # The cubes fall on z = 0: a map below it would hide under them, one above would hide them.
    points, _ = ground_triangles()
    assert points[:, 2].min() == 0.0
    assert points[:, 2].max() <= HILL_HEIGHT
    assert points[:, 2].max() > 1.0
    inside = np.hypot(points[:, 0], points[:, 1]) <= VALLEY_RADIUS
    assert inside.sum() > 100
    assert (points[inside, 2] == 0.0).all()


def test_the_height_is_0_up_to_the_radius_of_the_valley_and_rises_smoothly():
    angle = np.linspace(0.0, 6.0, 50)
    for share in (0.0, 0.3, 0.999):
        x, y = share * VALLEY_RADIUS * np.cos(angle), share * VALLEY_RADIUS * np.sin(angle)
        assert (ground_height(x, y) == 0.0).all()
    # At the edge the rise is quadratic: 3 (d / 40)^2 of the hills' height at most.
    for distance in (0.01, 0.1, 1.0):
        x = (VALLEY_RADIUS + distance) * np.cos(angle)
        y = (VALLEY_RADIUS + distance) * np.sin(angle)
        height = ground_height(x, y)
        assert (height >= 0.0).all()
        assert (height <= 3.001 * HILL_HEIGHT * (distance / 40) ** 2).all()


def test_colours_are_colours():
    _, colors = ground_triangles()
    assert (colors >= 0.0).all()
    assert (colors <= 1.0).all()
    assert (colors[:, 3] == 1.0).all()
    # One colour for the three corners of a triangle; and the floor is chequered.
    assert (colors.reshape(-1, 3, 4) == colors[::3, None]).all()
    assert len(np.unique(colors, axis=0)) > 2
