"""Where the page is served, checked before anything is started."""

from __future__ import annotations

import argparse
import ipaddress
import socket

LOOPBACK = '127.0.0.1'
PORT = 8080


class AddressError(ValueError):
    """A host or port that cannot be; the message says why."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --host, --port and --no-shadows."""
    parser.add_argument(
        '--host',
        default=LOOPBACK,
        help='address to serve the page at (default: %(default)s, this machine alone). 0.0.0.0 '
        'opens it to everyone who reaches this machine: there is no password, and whoever opens '
        'the page can throw, reset, change settings and record',
    )
    parser.add_argument(
        '--port', type=int, default=PORT, help='(default: %(default)s, or the next that is free)'
    )
    parser.add_argument(
        '--no-shadows',
        dest='shadows',
        action='store_false',
        help='draw less, for browsers without a graphics card',
    )


def check(host: str, port: int) -> None:
    """Raise AddressError unless a page can be served at `host`; 0 is any free port."""
    if not 0 <= port <= 65535:
        raise AddressError(f'--port is {port}: a number from 0 to 65535 is needed.')
    if 0 < port < 1024:
        raise AddressError(f"--port is {port}: those below 1024 are the system's.")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise AddressError(
            f'--host is {host!r}: this machine has no such address ({reason}).'
        ) from None


def url(host: str, port: int) -> str:
    """Return what to type into a browser on this machine."""
    shown = LOOPBACK if host in ('0.0.0.0', '') else '[::1]' if host == '::' else host
    return f'http://{f"[{shown}]" if ":" in shown and shown[0] != "[" else shown}:{port}'


def warning(host: str) -> str:
    """Return what serving at `host` means, '' when it is for this machine alone."""
    try:
        if ipaddress.ip_address(host).is_loopback:
            return ''
    except ValueError:
        if host == 'localhost':
            return ''
    return (
        f'The page is open to everyone who reaches this machine at {host}, without a password and '
        'unencrypted: they can throw, reset, change settings and record.'
    )
