"""Stage: the sky, the ground, the cubes and the cameras, as viser shows them."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from cube_sim.messages.decode import MessageError, read_marker
from cube_sim.messages.markers import PALETTE
from cube_sim.web.axes import page_wxyz

Floats = NDArray[np.float64]

# Where a page looks from at first, m: behind the camera of the simulator, and above it.
HOME = (-4.5, 2.5, 2.9)
HOME_LOOK_AT = (2.5, 0.0, 0.7)
FIELD_OF_VIEW = np.radians(60.0)

CONTACT_COLOR = (255, 40, 120)
NO_LINES: Floats = np.empty((0, 2, 3))

_ZENITH, _HORIZON = np.array([98.0, 151.0, 209.0]), np.array([222.0, 234.0, 243.0])
_COLORS = (PALETTE[:, :3] * 255).astype(np.uint8)

# A cube of side 1: each side has corners of its own, so that its light is flat.
_SIDES = np.array([[1, 2, 3], [2, 3, 1], [3, 1, 2], [-1, 3, 2], [-2, 1, 3], [-3, 2, 1]])


def _unit_cube() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    corners: list[Floats] = []
    faces: list[list[int]] = []
    axes = np.concatenate([np.zeros((1, 3)), np.eye(3)])

    def axis(number: int) -> Floats:
        way: Floats = np.sign(number) * axes[abs(number)]
        return way

    for out, right, up in _SIDES:
        first = len(corners)
        for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            corners.append((axis(out) + u * axis(right) + v * axis(up)) / 2.0)
        faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    return np.array(corners, np.float32), np.array(faces, np.uint32)


_CORNERS, _FACES = _unit_cube()


class Stage:
    """What every page of `server` shows; one thread at a time may call."""

    def __init__(self, server: viser.ViserServer, *, shadows: bool = True) -> None:
        """Set up sky, light and first view, without ground and cubes."""
        self._server = server
        self._cubes: Any = None
        self._size = 0.0
        self._contacts: Any = None
        scene = server.scene
        scene.set_up_direction('+z')
        share = np.linspace(0.0, 1.0, 64)[:, None, None] ** 0.7
        sky = _ZENITH + share * (_HORIZON - _ZENITH)
        scene.set_background_image(np.broadcast_to(sky, (64, 4, 3)).astype(np.uint8), format='png')
        # Lamps alone: light from an image costs a browser without a graphics card most of its time.
        scene.configure_environment_map(None)
        scene.configure_default_lights(enabled=True, cast_shadow=shadows)
        scene.add_light_hemisphere(
            '/light', sky_color=(226, 238, 255), ground_color=(122, 128, 104), intensity=2.2
        )
        server.initial_camera.position = HOME
        server.initial_camera.look_at = HOME_LOOK_AT
        server.initial_camera.fov = float(FIELD_OF_VIEW)
        server.initial_camera.far = 2000.0

    def show_cubes(self, poses: Floats, size: float) -> None:
        """Show a cube of side `size`, m, at each of `poses` (N, 7), m, x y z qx qy qz qw."""
        count = len(poses)
        if count == 0:
            if self._cubes is not None:
                self._cubes.remove()
                self._cubes = None
            return
        positions = poses[:, :3].astype(np.float32)
        wxyzs = poses[:, [6, 3, 4, 5]].astype(np.float32)
        if self._cubes is None:
            self._size = size
            self._cubes = self._server.scene.add_batched_meshes_simple(
                '/cubes',
                _CORNERS * np.float32(size),
                _FACES,
                batched_wxyzs=wxyzs,
                batched_positions=positions,
                batched_colors=_colors(count),
                lod='off',
            )
            return
        # Together, so that no page draws the places of one frame with the turns of another.
        with self._server.atomic():
            if len(self._cubes.batched_positions) != count:
                self._cubes.batched_colors = _colors(count)
            if self._size != size:
                self._size = size
                self._cubes.vertices = _CORNERS * np.float32(size)
            self._cubes.batched_positions = positions
            self._cubes.batched_wxyzs = wxyzs

    def show_ground(self, marker: bytes) -> None:
        """Show the height map of a visualization_msgs/Marker; MessageError if it is none."""
        points, colors = ground_of(marker)
        mesh = trimesh.Trimesh(
            points,
            np.arange(len(points)).reshape(-1, 3),
            vertex_colors=(colors * 255).astype(np.uint8),
            process=False,
        )
        self._server.scene.add_mesh_trimesh('/ground', mesh, cast_shadow=False, receive_shadow=0.4)

    def show_contacts(self, lines: Floats) -> None:
        """Show lines (K, 2, 3), m, from where cubes touch along the normals."""
        # A handle keeps the number of its lines, so each frame has one of its own.
        if self._contacts is not None and not len(lines):
            self._contacts.remove()
            self._contacts = None
        if len(lines):
            length = float(np.linalg.norm(lines[0, 1] - lines[0, 0]))
            self._contacts = self._server.scene.add_line_segments(
                '/contacts', lines.astype(np.float32), CONTACT_COLOR, thickness=0.04 * length
            )


class CameraSign:
    """A camera drawn into a scene: from where cubes are thrown."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Draw into `scene`, a page's or everyone's; nothing before `show`."""
        self._scene = scene
        self._sign: Any = None

    def show(self, pose: Floats, *, visible: bool = True) -> None:
        """Show it at x y z qx qy qz qw, m; x forward, y left, z up."""
        wxyz = page_wxyz(pose)
        if self._sign is None:
            self._sign = self._scene.add_camera_frustum(
                '/camera',
                fov=float(np.radians(45.0)),
                aspect=1.4,
                scale=0.35,
                thickness=0.015,
                color=(40, 44, 52),
                wxyz=wxyz,
                position=pose[:3],
                visible=visible,
            )
            return
        self._sign.position = pose[:3]
        self._sign.wxyz = wxyz
        self._sign.visible = visible


def ground_of(marker: bytes) -> tuple[Floats, NDArray[np.float32]]:
    """Return corners (3 T, 3), m, and colours (3 T, 4) of a Marker of triangles; MessageError."""
    view = read_marker(marker)
    if len(view.colors) != len(view.points) or len(view.points) % 3:
        raise MessageError(
            f'visualization_msgs/Marker has {len(view.points)} points and '
            f'{len(view.colors)} colours, no triangles'
        )
    return view.points, view.colors


def lines_of(marker: bytes) -> Floats:
    """Return the lines (K, 2, 3), m, of a Marker of type LINE_LIST; MessageError if it is none."""
    points = read_marker(marker).points
    if len(points) % 2:
        raise MessageError(f'visualization_msgs/Marker has {len(points)} points, no lines')
    return points.reshape(-1, 2, 3)


def _colors(count: int) -> NDArray[np.uint8]:
    """Return the colours of the first `count` cubes, those of the markers."""
    colors: NDArray[np.uint8] = _COLORS[np.arange(count) % len(_COLORS)]
    return colors


@contextlib.contextmanager
def serving(host: str, port: int, label: str) -> Iterator[viser.ViserServer]:
    """A server of pages; viser's own words about its start and end are not ours."""
    # A page that goes while it is being drawn on is no news.
    warnings.filterwarnings('ignore', r'Queued a \w+ on a closed connection', module='viser')
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    try:
        server.gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=(38, 110, 180)
        )
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
