"""The fixtures of ROS, a browser, and a bag, for this folder."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from node.ros_fixtures import *  # noqa: F403
from node.ros_session import RosSession
from support.bag_of_throws import write_bag
from web.web_chromium import DEADLINE, Chromium, find_chromium

pytest.importorskip('viser', reason='the page is made with viser: pip install viser')


@pytest.fixture(scope='session')
def chromium_process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    """A browser; tests that need one are skipped where none is installed."""
    program = find_chromium()
    if program is None:
        pytest.skip('no Chromium is installed: apt-get install chromium')
    browser = Chromium(program, tmp_path_factory.mktemp('chromium'))
    yield browser
    browser.close()


@pytest.fixture
def chromium(chromium_process: Chromium) -> Iterator[Chromium]:
    """The browser; the pages that a test opens are closed when it ends."""
    yield chromium_process
    chromium_process.close_pages()


class Served:
    """Pages of a simulator: their URL, what shows them, and where their cameras are."""

    def __init__(self, server: Any, live: Any) -> None:
        self.url = f'http://127.0.0.1:{server.get_port()}'
        self.live = live
        self._moved = threading.Condition()
        self._places: dict[int, Any] = {}
        server.on_client_connect(self._come)

    def wait_for_camera(self, found: Callable[[Any], bool]) -> None:
        """Wait until `found` holds for where the camera of one of the pages is."""
        with self._moved:
            came = self._moved.wait_for(lambda: any(map(found, self._places.values())), DEADLINE)
            assert came, f'the cameras are at {self._places}'

    def watch_contacts(self) -> queue.SimpleQueue[int]:
        """Return a queue of how many contacts the pages are given from now on."""
        shown: queue.SimpleQueue[int] = queue.SimpleQueue()
        show = self.live.stage.show_contacts

        def watched(lines: Any) -> None:
            show(lines)
            shown.put(len(lines))

        self.live.stage.show_contacts = watched
        return shown

    async def _come(self, client: Any) -> None:
        client.camera.on_update(self._take)
        await self._take(client.camera)

    async def _take(self, camera: Any) -> None:
        with self._moved:
            self._places[camera.client.client_id] = camera.position
            self._moved.notify_all()


@pytest.fixture
def live(ros: RosSession) -> Iterator[Callable[[], Served]]:
    """Serve the pages of the simulator in the test's context."""
    from cube_sim.remote import SimulatorLink
    from cube_sim.web.live import Live
    from cube_sim.web.stage import serving

    running = []

    def start() -> Served:
        server = serving('127.0.0.1', 0, 'cube_sim')
        at = server.__enter__()
        link = SimulatorLink('/cube_sim', name='web_view', context=ros.context)
        page = Live(at, link, shadows=False)
        page.start()
        running.append((server, page))
        return Served(at, page)

    yield start
    for server, page in running:
        page.close()
        server.__exit__(None, None, None)


@pytest.fixture(scope='session')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of two throws, a change of size, and a reset, without ROS running."""
    return write_bag(tmp_path_factory.mktemp('bags') / 'two_throws')
