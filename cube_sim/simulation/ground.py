"""The height map that marks the plane: hills around a flat valley floor at z = 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# The map is a square of CELLS by CELLS, each CELL_SIZE metres wide, centred on the origin.
CELLS = 32
CELL_SIZE = 4.0

# Within this distance of the origin the map is the plane, m; beyond, hills rise up to this, m.
VALLEY_RADIUS = 24.0
HILL_HEIGHT = 14.0

_GRASS = np.array([0.36, 0.55, 0.30])
_MEADOW = np.array([0.44, 0.60, 0.34])
_ROCK = np.array([0.52, 0.48, 0.42])
_SNOW = np.array([0.93, 0.94, 0.96])


def ground_triangles() -> tuple[Floats, Floats]:
    """
    Return the corners (3 T, 3), m, world, of the map's triangles, and their colours (3 T, 4).

    The same numbers on every machine: nothing but + - * / and square roots.
    """
    axis = (np.arange(CELLS + 1) - CELLS / 2) * CELL_SIZE
    x, y = np.meshgrid(axis, axis, indexing='ij')
    z = ground_height(x, y)
    corners = np.stack([x, y, z], axis=-1)
    low, right = corners[:-1, :-1], corners[1:, :-1]
    left, high = corners[:-1, 1:], corners[1:, 1:]
    triangles = np.stack([low, right, high, low, high, left], axis=2).reshape(-1, 3, 3)
    return triangles.reshape(-1, 3), np.repeat(_colors(triangles), 3, axis=0)


def ground_height(x: Floats, y: Floats) -> Floats:
    """Return the height of the map, m: 0 on the valley floor, hills around it."""
    rise = np.clip((np.sqrt(x * x + y * y) - VALLEY_RADIUS) / 40.0, 0.0, 1.0)
    rise = rise * rise * (3.0 - 2.0 * rise)
    noise = 0.6 * _noise(x / 19.0, y / 19.0) + 0.4 * _noise(x / 7.0 + 31.0, y / 7.0 + 17.0)
    return HILL_HEIGHT * rise * noise


def _colors(triangles: Floats) -> Floats:
    height = triangles[:, :, 2].mean(axis=1, keepdims=True)
    middle = triangles.mean(axis=1)
    squares = np.floor(middle[:, :2] / CELL_SIZE).sum(axis=1, keepdims=True) % 2
    grass = np.where(squares == 0, _GRASS, _MEADOW)
    share = np.clip((height - 1.0) / 4.0, 0.0, 1.0)
    color = grass + share * (_ROCK - grass)
    color = color + np.clip((height - 7.0) / 2.5, 0.0, 1.0) * (_SNOW - color)
    return np.concatenate([color, np.ones_like(height)], axis=1)


def _noise(x: Floats, y: Floats) -> Floats:
    """Return smooth noise from 0 to 1: hashed values on the whole numbers, blended between."""
    i, j = np.floor(x), np.floor(y)
    u, v = x - i, y - j
    u = u * u * (3.0 - 2.0 * u)
    v = v * v * (3.0 - 2.0 * v)
    low = _hashed(i, j) * (1.0 - u) + _hashed(i + 1, j) * u
    high = _hashed(i, j + 1) * (1.0 - u) + _hashed(i + 1, j + 1) * u
    blended: Floats = low * (1.0 - v) + high * v
    return blended


def _hashed(i: Floats, j: Floats) -> Floats:
    """Return a number from 0 to 1 that looks random, from two whole ones."""
    n = i.astype(np.int64).astype(np.uint32) * np.uint32(0x9E3779B1)
    n ^= j.astype(np.int64).astype(np.uint32) * np.uint32(0x85EBCA77)
    n ^= n >> np.uint32(15)
    n *= np.uint32(0x2C1B3C6D)
    n ^= n >> np.uint32(12)
    share: Floats = n.astype(np.float64) / 4294967296.0
    return share
