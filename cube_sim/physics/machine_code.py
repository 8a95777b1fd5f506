"""
Steps as machine code, kept on disk: one file for each function that Python calls.

numba compiles it once for a machine and a state of the sources, in a process of its own. What is
kept is the object code alone, and LLVM loads it without numba: that takes a tenth of the time
in which numba would be ready, so a process that finds it there does not feel it.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from cube_sim.physics.compiled import COMPILING, attributes
from cube_sim.physics.refusal import PhysicsError


@dataclass(frozen=True)
class Entry:
    """
    A function that Python calls as machine code.

    `make`, 'module:function', is called while compiling with numba's `types` and `carray`, and
    returns the signature and the Python function. Of its arguments, `addresses` come first and
    are arrays that the caller owns, then `numbers`, whole ones; it returns one. `name` begins
    the name of the file that holds it as `symbol`.
    """

    name: str
    symbol: str
    make: str
    addresses: tuple[str, ...]
    numbers: tuple[str, ...]


STEP = Entry(
    'step',
    'cube_sim_advance',
    'cube_sim.physics.step:entry',
    ('state', 'numbers', 'scratch'),
    ('capacity', 'first', 'last', 'steps', 'model'),
)
CONTACT = Entry(
    'contact',
    'cube_sim_contact',
    'cube_sim.physics.contact.advance:entry',
    (
        *('state', 'numbers', 'counters', 'cubes', 'marks', 'pairs', 'due', 'ends'),
        *('bodies', 'blocks', 'lanes', 'work', 'sites', 'scratch'),
    ),
    ('capacity', 'pair_capacity', 'block_capacity', 'site_capacity', 'count', 'steps'),
)
ENTRIES = {entry.name: entry for entry in (STEP, CONTACT)}

# Where numba's function puts its result and its error come first in a call.
_OUTPUTS = ('result', 'exception')

# What keeps the loaded code in memory.
_engines: list[Any] = []


class MachineCode:
    """An entry of machine code with the memory that one thread needs to call it."""

    def __init__(self, entry: Entry) -> None:
        """Load it, compiling it first when it is not there; PhysicsError when that fails."""
        self._function = _load(entry)
        self._names = (*_OUTPUTS, *entry.addresses, *entry.numbers)
        # A call in memory: every address and number takes eight bytes.
        self._call = (ctypes.c_int64 * len(self._names))()
        self._address = ctypes.addressof(self._call)
        self._place = {name: index for index, name in enumerate(self._names)}

    def set(self, **arguments: int) -> None:
        """Put addresses and numbers where the next calls find them."""
        for name, value in arguments.items():
            self._call[self._place[name]] = value

    def __call__(self) -> int:
        """Call it, without the GIL, and return its result."""
        self._function(self._address)
        return self._call[0]


@functools.cache
def _load(entry: Entry) -> Callable[..., int]:
    path = _object_file(entry)
    if not path.exists():
        _compile_elsewhere(entry, path)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(''), _target_machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(path.read_bytes()))
    engine.finalize_object()
    _engines.append(engine)
    # numba's status, 0 as nothing here raises; the address of a call.
    prototype = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
    return prototype(engine.get_function_address(entry.symbol))


@functools.cache
def _allow_long_loops() -> None:
    """
    Let LLVM make vectors of loops over the lanes of a block.

    They are short and touch many columns, more than it checks for overlap by default.
    """
    for option in (
        '-vectorizer-min-trip-count=4',
        '-memory-check-merge-threshold=4000',
        '-runtime-memory-check-threshold=64',
    ):
        llvm.set_option('cube_sim', option)


def compile_to(path: Path, entry: Entry = STEP) -> None:
    """Compile `entry` with numba and write its object code; for the compiling process."""
    module = llvm.parse_assembly(intermediate_code(entry))
    content = _target_machine().emit_object(module)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Two processes may do this at once: the name appears with the whole content or not at all.
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(content)
    Path(file.name).replace(path)


def assembly(entry: Entry = STEP) -> str:
    """Return `entry` in the assembly language of this machine; for the compiling process."""
    return str(_target_machine().emit_assembly(llvm.parse_assembly(intermediate_code(entry))))


def intermediate_code(entry: Entry = STEP) -> str:
    """
    Return `entry` as LLVM's intermediate code, optimised; for the compiling process.

    It stands alone: everything that it calls is in it. PhysicsError when it is not so.
    """
    from numba import carray, cfunc, types

    _allow_long_loops()
    module_name, _, maker = entry.make.partition(':')
    signature, function = getattr(importlib.import_module(module_name), maker)(types, carray)
    compiled = cfunc(signature)(function)
    inner = f'{entry.symbol}_numba'

    # Inside numba's C function, which would report errors through numba, is the bare one.
    code = compiled.inspect_llvm().replace(compiled.native_name.removeprefix('cfunc.'), inner)
    # The C library's root is as exact as the processor's, but it is a call.
    code = code.replace('@sqrt(', '@llvm.sqrt.f64(')
    # All memory is the caller's, none is numba's: nothing to count, and never any to give back.
    code = re.sub(r'^ *(tail )?call void @NRT_(inc|dec)ref\(.*\n', '', code, flags=re.MULTILINE)
    own = {
        'double @llvm.sqrt.f64': 'declare double @llvm.sqrt.f64(double)',
        'void @NRT_MemInfo_call_dtor': 'define void @NRT_MemInfo_call_dtor(ptr %0) { ret void }',
    }
    for name in own:
        code = re.sub(rf'^declare {re.escape(name)}\b.*\n', '', code, flags=re.MULTILINE)
    module = llvm.parse_assembly('\n'.join((code, *own.values(), _entry_code(entry, inner), '')))
    # As numba begins the names of functions: each part with its length before it.
    begins = {
        ''.join(f'{len(part)}{part}' for part in name.split('.')) + 'B': attribute
        for name, attribute in attributes.items()
    }
    for function in module.functions:
        if not function.is_declaration and function.name != entry.symbol:
            function.linkage = 'internal'
        for begin, attribute in begins.items():
            if begin in function.name and not function.is_declaration:
                function.add_function_attribute(attribute)
    # Only now that nothing else can call them does LLVM know what its functions are called with.
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = True
    builder = llvm.create_pass_builder(_target_machine(), options)
    builder.getModulePassManager().run(module, builder)
    outside = [
        function.name
        for function in module.functions
        if function.is_declaration and not function.name.startswith('llvm.')
    ]
    if outside:
        raise PhysicsError(f'The compiled step is not self-contained; it calls {outside}.')
    return str(module)


def _entry_code(entry: Entry, inner: str) -> str:
    """
    Return a function that takes the address of a call's numbers and makes it.

    With one argument a call from Python costs a third of what it does with ten.
    """
    lines = [f'define i32 @{entry.symbol}(ptr %call) {{']
    arguments = []
    for place, name in enumerate((*_OUTPUTS, *entry.addresses, *entry.numbers)):
        lines.append(f'  %at.{name} = getelementptr i64, ptr %call, i64 {place}')
        if name in _OUTPUTS:
            arguments.append(f'ptr %at.{name}')
        else:
            llvm_type = 'ptr' if name in entry.addresses else 'i64'
            lines.append(f'  %{name} = load {llvm_type}, ptr %at.{name}')
            arguments.append(f'{llvm_type} %{name}')
    lines.append(f'  %status = call i32 @{inner}({", ".join(arguments)})')
    return '\n'.join([*lines, '  ret i32 %status', '}'])


def _compile_elsewhere(entry: Entry, path: Path) -> None:
    sys.stderr.write('cube_sim: compiling the physics for this machine, once ...\n')
    done = subprocess.run(
        [sys.executable, '-m', 'cube_sim.physics.machine_code', entry.name, str(path)],
        # numba need not optimise: that is done once all functions are known (intermediate_code).
        env={
            **os.environ,
            COMPILING: '1',
            'NUMBA_OPT': '0',
            'PYTHONPATH': os.pathsep.join(sys.path),
        },
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


def _object_file(entry: Entry = STEP) -> Path:
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
    return _directory(room) / f'{entry.name}-{digest.hexdigest()[:24]}.o'


def _directory(room: Path) -> Path:
    beside = room / '__pycache__'
    if os.access(beside if beside.is_dir() else room, os.W_OK):
        return beside
    return Path(os.environ.get('XDG_CACHE_HOME') or '~/.cache').expanduser() / 'cube_sim'


if __name__ == '__main__':
    compile_to(Path(sys.argv[2]), ENTRIES[sys.argv[1]])
