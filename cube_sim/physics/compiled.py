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

# What LLVM is told of a function, by module.name.
attributes: dict[str, str] = {}


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


def compiled_alone(function: Function) -> Function:
    """
    Mark `function` as `compiled` does, and keep it out of the functions that call it.

    For short loops over many columns: LLVM makes vectors of them as long as it can tell the
    columns apart, which it no longer can in a function as large as a whole step.
    """
    return _compiled_as('noinline', function)


def compiled_inside(function: Function) -> Function:
    """Mark `function` as `compiled` does, and make it part of each loop that calls it."""
    return _compiled_as('alwaysinline', function)


def _compiled_as(attribute: str, function: Function) -> Function:
    attributes[f'{function.__module__}.{function.__name__}'] = attribute
    return compiled(function)
