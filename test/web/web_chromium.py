"""Headless Chromium, driven by its DevTools protocol."""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

DEADLINE = 30.0

NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--disable-dev-shm-usage',
    '--lang=en-US',
    '--remote-debugging-port=0',
)

_WAIT = """new Promise(resolve => {
  const end = Date.now() + %(deadline)d
  const look = () => {
    let value = null
    try { value = (%(expression)s) } catch (error) { value = null }
    if (value && typeof value === 'object') value = true
    if (value || Date.now() > end) resolve(value)
    else setTimeout(look, 50)
  }
  look()
})"""


def find_chromium() -> str | None:
    """Return the path of an installed Chromium, if there is one."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """A browser with a profile of its own, ended by its process group."""

    def __init__(self, program: str, profile: Path) -> None:
        """Start it; `profile` is to be empty."""
        from websockets.sync.client import connect

        # The page crashes in a browser that takes its language from the POSIX locale.
        environment = {**os.environ, 'LANG': 'en_US.UTF-8', 'LANGUAGE': 'en_US'}
        environment.pop('LC_ALL', None)
        self._process = subprocess.Popen(
            [program, *FLAGS, f'--user-data-dir={profile}', 'about:blank'],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        )
        assert self._process.stderr
        lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._reader = threading.Thread(
            target=lambda: [lines.put(line) for line in self._process.stderr], daemon=True
        )
        self._reader.start()
        while not (line := lines.get(timeout=DEADLINE)).startswith('DevTools listening on '):
            pass
        self._socket = connect(line.split()[-1], max_size=None, compression=None, proxy=None)
        self._lock = threading.Lock()
        self._number = 0
        self._targets: list[str] = []
        self._answers: dict[int, queue.SimpleQueue[Any]] = {}
        self._events: dict[str, Callable[[str, Any], None]] = {}
        self._receiver = threading.Thread(target=self._receive, daemon=True)
        self._receiver.start()

    def open(self, url: str, *, scale: float = 0.2) -> Page:
        """Open a page in a window of its own; drawn coarsely, as there is no graphics card."""
        target = self.send('Target.createTarget', {'url': 'about:blank', 'newWindow': True})
        attached = self.send(
            'Target.attachToTarget', {'targetId': target['targetId'], 'flatten': True}
        )
        page = Page(self, attached['sessionId'], url, scale)
        self._targets.append(target['targetId'])
        return page

    def close_pages(self) -> None:
        """Close all pages that `open` has opened."""
        while self._targets:
            self.send('Target.closeTarget', {'targetId': self._targets.pop()})

    def send(self, method: str, parameters: Any = None, session: str | None = None) -> Any:
        """Send a command and return its result."""
        answer: queue.SimpleQueue[Any] = queue.SimpleQueue()
        with self._lock:
            self._number += 1
            number = self._number
            self._answers[number] = answer
            message = {'id': number, 'method': method, 'params': parameters or {}}
            self._socket.send(
                json.dumps({**message, **({'sessionId': session} if session else {})})
            )
        result = answer.get(timeout=DEADLINE)
        assert 'error' not in result, f'{method}: {result}'
        return result['result']

    def listen(self, session: str, take: Callable[[str, Any], None]) -> None:
        """Hand the events of a page to `take`."""
        self._events[session] = take

    def close(self) -> None:
        """End the browser."""
        import signal

        self._socket.close()
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(DEADLINE)
        self._receiver.join(DEADLINE)
        self._reader.join(DEADLINE)
        self._process.stderr.close()

    def _receive(self) -> None:
        for text in self._socket:
            message = json.loads(text)
            if 'id' in message:
                self._answers.pop(message['id']).put(message)
            elif 'sessionId' in message and message['sessionId'] in self._events:
                self._events[message['sessionId']](message['method'], message['params'])


class Page:
    """A page of the browser: keys, JavaScript, screenshots, and what it complained of."""

    def __init__(self, browser: Chromium, session: str, url: str, scale: float) -> None:
        """Show `url`."""
        self.errors: list[str] = []
        self._browser = browser
        self._session = session
        browser.listen(session, self._take)
        for domain in ('Page', 'Runtime', 'Network'):
            self.send(f'{domain}.enable')
        self.send('Emulation.setLocaleOverride', {'locale': 'en-US'})
        self.send('Emulation.setFocusEmulationEnabled', {'enabled': True})
        self.requests: list[str] = []
        size = {'width': 1280, 'height': 800, 'deviceScaleFactor': scale, 'mobile': False}
        self.send('Emulation.setDeviceMetricsOverride', size)
        self.send('Page.navigate', {'url': url})

    def send(self, method: str, parameters: Any = None) -> Any:
        """Send a command for this page."""
        return self._browser.send(method, parameters, self._session)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression; promises are waited for."""
        result = self.send(
            'Runtime.evaluate',
            {'expression': expression, 'awaitPromise': True, 'returnByValue': True},
        )
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

    def wait_for(self, expression: str) -> Any:
        """Wait until a JavaScript expression is true, looked at whenever the page has changed."""
        value = self.evaluate(_WAIT % {'deadline': DEADLINE * 900, 'expression': expression})
        if not value:
            pytest.fail(f'not within {DEADLINE:g} s: {expression}; errors: {self.errors}')
        return value

    def press(self, key: str, code: str, number: int) -> None:
        """Press and release a key: its meaning, its place on the keyboard, its number."""
        for kind in ('keyDown', 'keyUp'):
            self.key(kind, key, code, number)

    def key(self, kind: str, key: str, code: str, number: int) -> None:
        """Send 'keyDown' or 'keyUp'."""
        self.send(
            'Input.dispatchKeyEvent',
            {'type': kind, 'key': key, 'code': code, 'windowsVirtualKeyCode': number},
        )

    def screenshot(self, path: Path) -> None:
        """Save what the page looks like."""
        import base64

        data = self.send('Page.captureScreenshot', {'format': 'png'})['data']
        path.write_bytes(base64.b64decode(data))

    def _take(self, method: str, parameters: Any) -> None:
        if method == 'Runtime.exceptionThrown':
            details = parameters['exceptionDetails']
            self.errors.append(str(details.get('exception', details).get('description', details)))
        elif method == 'Network.requestWillBeSent':
            self.requests.append(parameters['request']['url'])
