"""The executable `cube_bag`."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

from cube_sim.recording import RecordingError

# In the order of the help; a module of this package each.
COMMANDS = ('report', 'verify', 'compare', 'export', 'recover')

DONE, DIFFERS, REFUSED, INTERRUPTED = 0, 1, 2, 130

_EXIT_CODES = """\
exit codes:
  0    done; verify: everything is as simulated; compare: the runs are equal
  1    verify: something differs or cannot be verified; compare: the runs differ;
       recover: nothing could be had
  2    refused: wrong arguments, or a bag that cannot be read (one sentence on stderr)
  130  interrupted
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    parser = argparse.ArgumentParser(
        prog='cube_bag',
        description='What a recording says, whether it is true, and what is left of a broken one.',
        epilog=_EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    # Only the command that is asked for is loaded: figures and pages take long to import.
    asked = next((word for word in arguments if not word.startswith('-')), None)
    modules: dict[str, Any] = {}
    for name in COMMANDS if asked not in COMMANDS else (asked,):
        modules[name] = importlib.import_module(f'cube_sim.bag.{name}')
        summary = modules[name].SUMMARY
        command = commands.add_parser(
            name,
            help=summary,
            description=summary,
            epilog=_EXIT_CODES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_argument('--json', action='store_true', help='print JSON for machines')
        modules[name].add_arguments(command)
    given = parser.parse_args(arguments)
    return _run(modules[given.command], given)


def _run(module: Any, given: argparse.Namespace) -> int:
    from rich.console import Console

    try:
        code: int = module.run(given, Console(highlight=False, soft_wrap=True))
        return code
    except RecordingError as error:
        sys.stderr.write(f'cube_bag: {error}\n')
        return REFUSED
    except KeyboardInterrupt:
        sys.stderr.write('cube_bag: interrupted\n')
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read the output has had enough; nothing more may be written at the exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE


if __name__ == '__main__':
    sys.exit(main())
