"""
Make the pictures of the README: `python docs/make_pictures.py [FOLDER]`.

The paths are computed here, by the World that the node runs; the same code draws the same lines.
"""

from __future__ import annotations

import math
import sys
from itertools import product
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Polygon
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from cube_sim.messages.markers import PALETTE
from cube_sim.physics import Settings, World
from cube_sim.physics.world import turned_by
from cube_sim.simulation import Throwing

mpl.use('Agg')
import matplotlib.pyplot as plt

Floats = NDArray[np.float64]

# How the cubes are thrown: by camera angles above the horizon, from this height.
PITCHES_DEG = (0.0, 40.0)
CAMERA_HEIGHT = 1.5
SECONDS = 6.0
# Between two cubes that are drawn, s of simulated time, as long as a cube moves.
FLASH = 0.16

DROP_HEIGHT = 1.0
DROP_RESTITUTION = 0.8
DROP_SECONDS = 3.6

INK, FAINT, GROUND = '#333333', '#d8d8d8', '#efece4'
# The light comes from above, from the left and from where one looks.
LIGHT = np.array([-0.35, -0.55, 0.75])
# Two of the markers' colours, one for each throw.
COLORS = [tuple(float(c) for c in PALETTE[i][:3]) for i in (1, 0)]


def thrown(model: str, pitch_deg: float) -> Floats:
    """Return the poses (steps + 1, 7) of one cube, m, world, thrown as ~/throw does."""
    throwing = Throwing()
    half = -0.5 * math.radians(pitch_deg)
    camera = (0.0, math.sin(half), 0.0, math.cos(half))
    world = World(Settings(model=model))
    world.throw(
        (0.0, 0.0, CAMERA_HEIGHT),
        camera,
        turned_by(camera, (throwing.throw_speed, 0.0, 0.0)),
        turned_by(camera, throwing.throw_spin),
    )
    return path(world, SECONDS)


def dropped(model: str) -> Floats:
    """Return the poses (steps + 1, 7) of a cube that falls flat, m, world."""
    settings = Settings(model=model, restitution=DROP_RESTITUTION)
    world = World(settings)
    world.throw((0.0, 0.0, DROP_HEIGHT + settings.cube_size / 2), (0.0, 0.0, 0.0, 1.0))
    return path(world, DROP_SECONDS)


def path(world: World, seconds: float) -> Floats:
    """Return the poses of the world's one cube at each step, the present one first."""
    poses = [world.poses[0].copy()]
    for _ in range(round(seconds / world.settings.time_step)):
        world.step()
        poses.append(world.poses[0].copy())
    return np.array(poses)


def draw_cube(axes: Axes, pose: Floats, color: tuple[float, ...], order: float) -> None:
    """Draw a cube as seen along +y: its faces that look this way, each in its own light."""
    half = Settings().cube_size / 2
    columns = [turned_by(pose[3:], axis) for axis in np.eye(3)]
    for axis, sign in product(range(3), (-1.0, 1.0)):
        normal = sign * columns[axis]
        if normal[1] >= 0.0:
            continue
        first, second = (columns[i] * half for i in range(3) if i != axis)
        middle = pose[:3] + normal * half
        corners = [middle + i * first + j * second for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        light = 0.70 + 0.30 * float(normal @ LIGHT) / float(np.linalg.norm(LIGHT))
        face = tuple(min(1.0, light * c + 0.06) for c in to_rgb(color))
        axes.add_patch(
            Polygon(
                [(x, z) for x, _, z in corners],
                facecolor=face,
                edgecolor='white',
                linewidth=0.4,
                zorder=order,
            )
        )


def draw_throws(axes: Axes, model: str, title: str) -> None:
    """Draw the side view of the throws under `model`."""
    flash = round(FLASH / Settings().time_step)
    for color, pitch in zip(COLORS, PITCHES_DEG, strict=True):
        poses = thrown(model, pitch)
        axes.plot(poses[:, 0], poses[:, 2], color=color, linewidth=0.9, alpha=0.8, zorder=2)
        shown = poses[0]
        draw_cube(axes, shown, color, 3.0)
        for pose in [*poses[flash::flash], poses[-1]]:
            # One that lies still is drawn once.
            if np.linalg.norm(pose[:3] - shown[:3]) > 0.35:
                draw_cube(axes, pose, color, 3.0)
                shown = pose
    for color, (x, z), text in zip(
        COLORS, ((0.3, 0.6), (-0.4, 2.9)), ('thrown level', 'thrown 40° up'), strict=True
    ):
        axes.text(x, z, text, color=color, fontsize=9, va='center')
    axes.axhspan(-0.5, 0.0, color=GROUND, zorder=0)
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
    axes.set_aspect('equal')
    axes.set_xlim(-0.6, 14.6)
    axes.set_ylim(-0.3, 3.4)
    axes.yaxis.set_major_locator(MultipleLocator(1.0))
    axes.xaxis.set_major_locator(MultipleLocator(2.0))
    axes.set_ylabel('height z, m')
    axes.set_title(title, loc='left', fontsize=10, color=INK)


def draw_drop(axes: Axes) -> None:
    """Draw the height of a flat drop over time under both models, and the closed form."""
    step, half = Settings().time_step, Settings().cube_size / 2
    for model, color, width, style in (
        ('simple', COLORS[0], 3.0, '-'),
        ('impulse', COLORS[1], 1.2, (0, (4, 3))),
    ):
        height = dropped(model)[:, 2] - half
        axes.plot(
            np.arange(len(height)) * step,
            height,
            color=color,
            linewidth=width,
            linestyle=style,
            label=model,
        )
    # The n-th apex comes after the fall and n bounces, the k-th of which lasts 2 e^k t_fall.
    fall = math.sqrt(2 * DROP_HEIGHT / Settings().gravity)
    e = DROP_RESTITUTION
    times, heights = [], []
    for n in range(1, 7):
        times.append(fall * (1 + 2 * sum(e**k for k in range(1, n)) + e**n))
        heights.append(e ** (2 * n) * DROP_HEIGHT)
    axes.plot(
        times,
        heights,
        linestyle='none',
        marker='o',
        markersize=6,
        markerfacecolor='none',
        markeredgecolor=INK,
        label=r'closed form $e^{2n} h$',
    )
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
    axes.set_xlim(0.0, DROP_SECONDS)
    axes.set_ylim(-0.04, 1.1)
    axes.set_xlabel('time, s')
    axes.set_ylabel('gap to the plane, m')
    axes.set_title(
        f'A flat drop from h = {DROP_HEIGHT:g} m, restitution e = {e:g}: the models agree',
        loc='left',
        fontsize=10,
        color=INK,
    )
    axes.legend(frameon=False, fontsize=9, loc='upper right')


def make_throws(target: Path) -> None:
    """Write the picture of the README to `target`."""
    settings, throwing = Settings(), Throwing()
    style = {
        'font.size': 9,
        'axes.edgecolor': INK,
        'axes.labelcolor': INK,
        'xtick.color': INK,
        'ytick.color': INK,
        'axes.spines.top': False,
        'axes.spines.right': False,
        'axes.grid': True,
        'axes.axisbelow': True,
        'grid.color': FAINT,
        'grid.linewidth': 0.5,
    }
    with plt.rc_context(style):
        figure, (top, middle, bottom) = plt.subplots(
            3, 1, figsize=(9.0, 7.6), height_ratios=(1.25, 1.25, 1.0), layout='constrained'
        )
        draw_throws(
            top,
            'simple',
            f'Model simple, side view: two throws at {throwing.throw_speed:g} m/s, '
            f'a cube drawn every {FLASH:g} s (e = {settings.restitution:g}, '
            f'f = {settings.tangential_factor:g})',
        )
        draw_throws(
            middle,
            'impulse',
            f'Model impulse, side view: the same throws (e = {settings.restitution:g}, '
            f'μ = {settings.friction:g})',
        )
        middle.set_xlabel('x, m')
        draw_drop(bottom)
        figure.savefig(target, dpi=115, metadata={'Software': None}, facecolor='white')
        plt.close(figure)


def main(argv: list[str]) -> int:
    """Write every picture to the folder that is given, or beside this file."""
    folder = Path(argv[0]) if argv else Path(__file__).parent
    make_throws(folder / 'throws.png')
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
