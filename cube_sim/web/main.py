"""The executable `web_view`."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import threading
from pathlib import Path
from types import FrameType

from cube_sim.web import address

REFUSED = 2

_DESCRIPTION = """\
Shows a simulator in a browser: the page's keys are those of the report, by their place on the
keyboard (W S A D E Q of an English one are Z S Q D E A of a French one), Space throws from where
the page looks, Tab changes the physics model. With --bag it plays a recording, without ROS running.
"""


def main(argv: list[str] | None = None) -> int:
    """Serve the page until asked to end; return the exit code."""
    given = sys.argv if argv is None else ['web_view', *argv]
    own = given[1 : given.index('--ros-args')] if '--ros-args' in given else given[1:]
    parser = _parser()
    arguments = parser.parse_args(own)
    if arguments.export and not arguments.bag:
        parser.error('--export writes a recording: name it with --bag')
    try:
        address.check(arguments.host, arguments.port)
    except address.AddressError as error:
        return refused(str(error))
    try:
        import viser  # noqa: F401
    except ImportError:
        return refused('the page needs the package viser: pip install "cube_sim[web]"')
    if arguments.export:
        return _export(arguments)
    stop = asked_to_stop()
    if arguments.bag:
        return _play(arguments, stop)
    return _live(arguments, given, stop)


def asked_to_stop() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set, however often they come."""
    stop = threading.Event()

    def ask(_: int, __: FrameType | None) -> None:
        stop.set()

    signal.signal(signal.SIGINT, ask)
    signal.signal(signal.SIGTERM, ask)
    return stop


def say(line: str) -> None:
    """Write a line, at once."""
    sys.stdout.write(f'{line}\n')
    sys.stdout.flush()


def refused(why: str) -> int:
    """Say why nothing is done."""
    sys.stderr.write(f'web_view: {why}\n')
    return REFUSED


def announce(host: str, asked: int, port: int) -> None:
    """Say where the page is, and for whom."""
    if asked not in (0, port):
        say(f'Port {asked} is taken; the next free one is {port}.')
    say(f'page: {address.url(host, port)}')
    if warning := address.warning(host):
        say(warning)


def _live(arguments: argparse.Namespace, given: list[str], stop: threading.Event) -> int:
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from cube_sim.remote import SimulatorLink
    from cube_sim.web.live import Live
    from cube_sim.web.stage import serving

    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
        link = SimulatorLink(arguments.simulator, name='web_view')
    except Exception as error:
        rclpy.try_shutdown()
        return refused(str(error))
    with serving(arguments.host, arguments.port, 'cube_sim') as server:
        live = Live(server, link, shadows=arguments.shadows)
        live.start()
        try:
            announce(arguments.host, arguments.port, server.get_port())
            told: bool | None = None
            while not stop.wait(0.2 if told is not None else 3.0):
                if link.present != told:
                    told = link.present
                    say(f'{link.simulator} answers.' if told else link.absence)
        finally:
            live.close()
            rclpy.try_shutdown()
    return 0


def _play(arguments: argparse.Namespace, stop: threading.Event) -> int:
    from cube_sim.recording import RecordingError
    from cube_sim.web.playback import Recorded
    from cube_sim.web.player import Player
    from cube_sim.web.stage import serving

    try:
        run = Recorded.read(arguments.bag, arguments.simulator)
    except RecordingError as error:
        return refused(str(error))
    with serving(arguments.host, arguments.port, 'cube_sim') as server:
        player = Player(server, run, shadows=arguments.shadows)
        player.start()
        announce(arguments.host, arguments.port, server.get_port())
        stop.wait()
        player.close()
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from cube_sim.recording import RecordingError
    from cube_sim.web.export import export
    from cube_sim.web.playback import Recorded

    path = Path(arguments.export)
    try:
        frames = export(Recorded.read(arguments.bag, arguments.simulator), path)
    except FileExistsError:
        return refused(f'{path} exists already, not overwriting.')
    except (RecordingError, OSError) as error:
        return refused(str(error))
    except KeyboardInterrupt:
        return 130
    size = path.stat().st_size / 1e6
    with contextlib.suppress(BrokenPipeError):
        say(f'{path}: {frames} frames, {size:.1f} MB')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='web_view',
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    address.add_arguments(parser)
    parser.add_argument(
        '--simulator', default='/cube_sim', metavar='NAME', help='its node (default: %(default)s)'
    )
    parser.add_argument('--bag', metavar='BAG', help='play this recording')
    parser.add_argument(
        '--export', metavar='FILE.html', help='write the recording as one file, and end'
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
