"""
The step as machine code, kept on disk.

numba compiles it once for a machine and a state of the sources, in a process of its own. What is
kept is the object code alone, and LLVM loads it without numba: that takes a tenth of the time
in which numba would be ready, so a process that finds it there does not feel it.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import COMPILING
from cube_sim.physics.constants import Constants
from cube_sim.physics.refusal import PhysicsError
from cube_sim.physics.step import BLOCK, SCRATCH_ROWS

Floats = NDArray[np.float64]

_SYMBOL = 'cube_sim_advance'
_NUMBA_SYMBOL = 'cube_sim_advance_numba'


class _Call(ctypes.Structure):
    """A call in memory: where numba's function puts things, then its arguments in order."""

    _fields_ = (
        ('contacts', ctypes.c_int64),
        ('exception', ctypes.c_void_p),
        ('state', ctypes.c_void_p),
        ('capacity', ctypes.c_int64),
        ('first', ctypes.c_int64),
        ('last', ctypes.c_int64),
        ('steps', ctypes.c_int64),
        ('model', ctypes.c_int64),
        ('numbers', ctypes.c_void_p),
        ('scratch', ctypes.c_void_p),
    )


# What keeps the loaded code in memory.
_engines: list[Any] = []


class CompiledStep:
    """The compiled `step.advance`, with the memory that one thread needs to call it."""

    def __init__(self) -> None:
        """Load it, compiling it first when it is not there; PhysicsError when that fails."""
        self._function = _load()
        self._scratch = np.empty((SCRATCH_ROWS, BLOCK))
        self._call = _Call(scratch=self._scratch.ctypes.data)
        self._address = ctypes.addressof(self._call)

    def use(self, state: Floats, model: int, numbers: Floats) -> None:
        """Work on `state` (13, capacity) from now on; all three are those of `step.advance`."""
        self._memory = state, numbers
        call = self._call
        call.state, call.capacity = state.ctypes.data, state.shape[1]
        call.model, call.numbers = model, numbers.ctypes.data

    def advance(self, first: int, last: int, steps: int) -> int:
        """Advance the cubes first to last - 1, without the GIL; return their contacts."""
        call = self._call
        call.first, call.last, call.steps = first, last, steps
        self._function(self._address)
        contacts: int = call.contacts
        return contacts


@functools.lru_cache(maxsize=1)
def _load() -> Callable[..., int]:
    path = _object_file()
    if not path.exists():
        _compile_elsewhere(path)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(''), _target_machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(path.read_bytes()))
    engine.finalize_object()
    _engines.append(engine)
    # numba's status, 0 as nothing here raises; the address of a _Call.
    prototype = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
    return prototype(engine.get_function_address(_SYMBOL))


def compile_to(path: Path) -> None:
    """Compile the step with numba and write its object code; for the compiling process."""
    module = llvm.parse_assembly(intermediate_code())
    content = _target_machine().emit_object(module)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Two processes may do this at once: the name appears with the whole content or not at all.
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(content)
    Path(file.name).replace(path)


def assembly() -> str:
    """Return the step in the assembly language of this machine; for the compiling process."""
    return str(_target_machine().emit_assembly(llvm.parse_assembly(intermediate_code())))


def intermediate_code() -> str:
    """
    Return the step as LLVM's intermediate code, optimised; for the compiling process.

    It stands alone: everything that it calls is in it. PhysicsError when it is not so.
    """
    from numba import carray, cfunc, types

    from cube_sim.physics import step

    floats, integer = types.CPointer(types.float64), types.int64
    rows, scratch_shape = step.ROWS, (step.SCRATCH_ROWS, step.BLOCK)
    numbers_count = len(Constants._fields)

    @cfunc(integer(floats, integer, integer, integer, integer, integer, floats, floats))
    def entry(  # type: ignore[no-untyped-def]
        state, capacity, first, last, steps, model, numbers, scratch
    ):
        return step.advance(
            carray(state, (rows, capacity)),
            first,
            last,
            steps,
            model,
            carray(numbers, numbers_count),
            carray(scratch, scratch_shape),
        )

    # Inside numba's C function, which would report errors through numba, is the bare one.
    code = entry.inspect_llvm().replace(entry.native_name.removeprefix('cfunc.'), _NUMBA_SYMBOL)
    # The C library's root is as exact as the processor's, but it is a call.
    code = code.replace('@sqrt(', '@llvm.sqrt.f64(')
    # All memory is the caller's, none is numba's: there is never any to give back.
    own = {
        'double @llvm.sqrt.f64': 'declare double @llvm.sqrt.f64(double)',
        'void @NRT_MemInfo_call_dtor': 'define void @NRT_MemInfo_call_dtor(ptr %0) { ret void }',
    }
    for name in own:
        code = re.sub(rf'^declare {re.escape(name)}\b.*\n', '', code, flags=re.MULTILINE)
    module = llvm.parse_assembly('\n'.join((code, *own.values(), _entry_code(), '')))
    for function in module.functions:
        if not function.is_declaration and function.name != _SYMBOL:
            function.linkage = 'internal'
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    options = llvm.create_pipeline_tuning_options(speed_level=0)
    passes.run(module, llvm.create_pass_builder(_target_machine(), options))
    outside = [
        function.name
        for function in module.functions
        if function.is_declaration and not function.name.startswith('llvm.')
    ]
    if outside:
        raise PhysicsError(f'The compiled step is not self-contained; it calls {outside}.')
    return str(module)


def _entry_code() -> str:
    """
    Return a function that takes the address of a _Call and makes it.

    With one argument a call from Python costs a third of what it does with ten.
    """
    size = ctypes.sizeof(ctypes.c_int64)
    lines = [f'define i32 @{_SYMBOL}(ptr %call) {{']
    arguments = []
    for name, kind in _Call._fields_:
        place = getattr(_Call, name).offset // size
        lines.append(f'  %at.{name} = getelementptr i64, ptr %call, i64 {place}')
        if name in ('contacts', 'exception'):
            arguments.append(f'ptr %at.{name}')
        else:
            llvm_type = 'ptr' if kind is ctypes.c_void_p else 'i64'
            lines.append(f'  %{name} = load {llvm_type}, ptr %at.{name}')
            arguments.append(f'{llvm_type} %{name}')
    lines.append(f'  %status = call i32 @{_NUMBA_SYMBOL}({", ".join(arguments)})')
    return '\n'.join([*lines, '  ret i32 %status', '}'])


def _compile_elsewhere(path: Path) -> None:
    sys.stderr.write('cube_sim: compiling the physics for this machine, once ...\n')
    done = subprocess.run(
        [sys.executable, '-m', 'cube_sim.physics.machine_code', str(path)],
        env={**os.environ, COMPILING: '1', 'PYTHONPATH': os.pathsep.join(sys.path)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode or not path.exists():
        last = (done.stderr.strip() or 'no message').splitlines()[-1]
        raise PhysicsError(f'The physics could not be compiled to {path}: {last}')


def _target_machine() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=3,
        jit=True,
    )


def _object_file() -> Path:
    """Return where the code is kept: one file for each machine and state of the sources."""
    room = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(room.rglob('*.py')):
        digest.update(source.read_bytes())
    for part in (
        llvmlite.__version__,
        llvm.get_default_triple(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    ):
        digest.update(part.encode())
    return _directory(room) / f'step-{digest.hexdigest()[:24]}.o'


def _directory(room: Path) -> Path:
    beside = room / '__pycache__'
    if os.access(beside if beside.is_dir() else room, os.W_OK):
        return beside
    return Path(os.environ.get('XDG_CACHE_HOME') or '~/.cache').expanduser() / 'cube_sim'


if __name__ == '__main__':
    compile_to(Path(sys.argv[1]))
