"""Write the table of the parameters into the README: `.venv/bin/python docs/make_tables.py`."""

from __future__ import annotations

import sys
from pathlib import Path

from cube_sim.node.parameters import markdown_table

README = Path(__file__).parent.parent / 'README.md'
BEGIN, END = '<!-- parameters:', '<!-- end of parameters -->'


def with_table(text: str) -> str:
    """Return `text` with what stands between the two comments made anew."""
    head, comment, rest = text.partition(BEGIN)
    first_line, _, rest = rest.partition('\n')
    _, end, tail = rest.partition(END)
    if not comment or not end:
        raise ValueError(f'{README} has no "{BEGIN}" followed by "{END}"; restore them.')
    return f'{head}{comment}{first_line}\n\n{markdown_table()}\n\n{end}{tail}'


def main() -> int:
    """Rewrite the README."""
    README.write_text(with_table(README.read_text(encoding='utf-8')), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
