"""
The marker of functions that become machine code.

In the process that compiles them they are numba's; anywhere else they stay plain Python, the
laws as they are written, which a reader can call and a test can compare with the machine code.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TypeVar, cast

Function = TypeVar('Function', bound=Callable[..., object])

# Set for the compiling process by `machine_code`.
COMPILING = 'CUBE_SIM_COMPILING'


def compiled(function: Function) -> Function:
    """
    Mark `function` for IEEE-754 machine code.

    No fast-math and no contraction: every + - * / and square root is rounded on its own, so
    the same inputs give the same bits on every machine, and the same bits as plain Python.
    """
    if not os.environ.get(COMPILING):
        return function
    from numba import njit

    return cast(Function, njit(error_model='numpy')(function))
