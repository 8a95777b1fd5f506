"""The compiled step: what instructions it has, what it needs, and how it is kept on disk."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.physics_golden import GOLDEN

import cube_sim
from cube_sim.physics import machine_code

# Intrinsics that are instructions, or that numba's array bookkeeping needs: none of them rounds
# anything that IEEE-754 does not round, and none becomes a call into the mathematical library.
HARMLESS = re.compile(
    r'llvm\.(sqrt|fabs)\.(v\d+)?f64'
    r'|llvm\.(smin|smax|umin|umax|abs)\.(v\d+)?i\d+'
    r'|llvm\.vector\.reduce\.(add|or|and)\.v\d+i\d+'
    r'|llvm\.(lifetime\.(start|end)|assume|memset|memcpy|memmove'
    r'|experimental\.noalias\.scope\.decl)\S*'
    r'|llvm\.x86\.atomic\.(add|sub)\.cc\.i64'
)

TIMEOUT = 100


def environment(**changes: str) -> dict[str, str]:
    return {**os.environ, **changes}


@pytest.fixture(scope='module')
def started(tmp_path_factory):
    """
    Two processes side by side: one that shows the code, one that compiles a cold copy.

    The cold copy is compiled for the least of processors: it has no vectors and no fused
    instructions, and must yield the same bits.
    """
    shown = tmp_path_factory.mktemp('shown')
    show = subprocess.Popen(
        [
            sys.executable,
            '-c',
            SHOW,
            str(shown),
        ],
        env=environment(CUBE_SIM_COMPILING='1', PYTHONPATH=os.pathsep.join(sys.path)),
    )
    cold = copied(tmp_path_factory.mktemp('cold'))
    compiling = start(cold, RUN, NUMBA_CPU_NAME='generic', NUMBA_CPU_FEATURES='')
    yield shown, show, cold, compiling
    for process in (show, compiling):
        process.kill()
        process.communicate()


def copied(folder: Path) -> Path:
    """A copy of the package without anything compiled; its physics is all that is needed."""
    package = Path(cube_sim.__file__).parent
    shutil.copytree(
        package / 'physics',
        folder / 'cube_sim' / 'physics',
        ignore=shutil.ignore_patterns('__pycache__'),
    )
    shutil.copy(package / '__init__.py', folder / 'cube_sim')
    return folder


SHOW = """
import pathlib, sys
from cube_sim.physics import machine_code
folder = pathlib.Path(sys.argv[1])
(folder / 'code.s').write_text(machine_code.assembly())
(folder / 'code.ll').write_text(machine_code.intermediate_code())
"""

RUN = """
import sys
from cube_sim.physics import Settings, World
import cube_sim.physics
from support.physics_golden import run_script
for model in ('simple', 'impulse'):
    world = World(Settings(model=model, time_step_ns=5_000_000))
    run_script(world, world.step)
    print(world.digest())
print(sorted({'numba', 'rclpy'} & set(sys.modules)))
print(cube_sim.physics.__file__)
"""


def start(folder: Path, code: str, **variables: str) -> subprocess.Popen[str]:
    tests = Path(__file__).parent.parent
    paths = [str(folder), str(tests), *filter(None, sys.path)]
    return subprocess.Popen(
        [sys.executable, '-c', code],
        env=environment(PYTHONPATH=os.pathsep.join(paths), **variables),
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture(scope='module')
def assembly(started) -> str:
    shown, show, _, _ = started
    assert show.wait(TIMEOUT) == 0
    return (shown / 'code.s').read_text()


@pytest.fixture(scope='module')
def intermediate(started, assembly) -> str:
    return (started[0] / 'code.ll').read_text()


def test_the_machine_code_fuses_no_multiplication_with_an_addition(assembly):
    # x86: vfmadd, vfmsub, vfnmadd; ARM: fmadd, fmla and their kin.
    assert re.findall(r'\b(?:v?fn?m(?:add|sub|la|ls)\w*)', assembly) == []
    assert 'sqrt' in assembly
    assert 'div' in assembly


def test_the_machine_code_refers_to_nothing_outside_itself(assembly):
    # What is called, through a register or not, is a label of the same text; memset is libc's.
    defined = set(re.findall(r'^"?([\w.$]+)"?:', assembly, re.MULTILINE))
    referred = set(
        re.findall(r'^\s+(?:call\w*|bl|jmp)[ \t]+([A-Za-z_][\w.$@]*)', assembly, re.MULTILINE)
    )
    referred |= set(re.findall(r'movabsq?\s+\$"?([A-Za-z_.][\w.$]*)', assembly))
    assert {name.split('@')[0] for name in referred} - defined - {'memset', 'memcpy'} == set()
    assert 'cube_sim_advance' in defined


def test_the_intermediate_code_calls_itself_and_plain_intrinsics_alone(intermediate):
    defined = set(re.findall(r'^define .*?@"?([\w.$]+)"?\(', intermediate, re.MULTILINE))
    called = set(re.findall(r'\b(?:call|invoke) [^@\n]*@"?([\w.$]+)"?\(', intermediate))
    declared = set(re.findall(r'^declare .*?@"?([\w.$]+)"?\(', intermediate, re.MULTILINE))
    assert 'cube_sim_advance' in defined
    assert len(called) > 5
    outside = (called | declared) - defined
    assert [name for name in outside if not HARMLESS.fullmatch(name)] == []


def test_no_operation_may_be_rounded_otherwise_than_as_written(intermediate):
    # An operation of floats may carry fast-math flags before its type: none does.
    flags = re.findall(r'\bf(?:add|sub|mul|div|neg|cmp|rem) ([a-z ]*)(?:double|<)', intermediate)
    assert len(flags) > 200
    flag_words = {'fast', 'nnan', 'ninf', 'nsz', 'arcp', 'contract', 'afn', 'reassoc'}
    assert flag_words & {word for flag in flags for word in flag.split()} == set()
    assert 'frem' not in intermediate
    assert 'float>' not in intermediate  # nothing in single precision
    assert re.search(r'call (?:fast|nnan|ninf|nsz|arcp|contract|afn|reassoc)', intermediate) is None


def test_a_cold_start_compiles_and_the_next_process_loads_without_numba(started):
    _, _, cold, compiling = started
    cache = cold / 'cube_sim' / 'physics' / '__pycache__'
    for process, compiles in ((compiling, True), (start(cold, RUN), False)):
        output, errors = process.communicate(timeout=TIMEOUT)
        assert process.returncode == 0, errors
        *digests, imported, file = output.splitlines()
        assert Path(file).parent == cold / 'cube_sim' / 'physics'
        assert digests == [GOLDEN['simple'], GOLDEN['impulse']]
        assert imported == '[]'
        assert ('compiling the physics' in errors) == compiles
        (kept,) = cache.glob('step-*.o')
        assert kept.stat().st_size > 1000
        # Nothing half-written stays behind.
        assert not list(cache.glob('tmp*'))


def test_changed_sources_are_not_served_by_old_machine_code(tmp_path):
    code = 'from cube_sim.physics import machine_code as code;print(code._object_file().name)'
    names = []
    for text in ('', '# changed\n'):
        folder = copied(tmp_path / f'sources{len(text)}')
        with (folder / 'cube_sim' / 'physics' / 'models' / 'impulse.py').open('a') as file:
            file.write(text)
        output, errors = start(folder, code).communicate(timeout=TIMEOUT)
        assert output, errors
        names.append(output)
    assert names[0] != names[1]


def test_a_compilation_that_fails_is_one_error_that_says_why(tmp_path):
    folder = copied(tmp_path)
    (folder / 'numba.py').write_text('raise ImportError("numba is not for today")')
    code = (
        'from cube_sim.physics import PhysicsError, World\n'
        'try:\n    World()\nexcept PhysicsError as error:\n    print(error)\n'
    )
    output, errors = start(folder, code).communicate(timeout=TIMEOUT)
    assert output.startswith('The physics could not be compiled to '), errors
    assert output.endswith(': ImportError: numba is not for today\n')
    assert not list((folder / 'cube_sim' / 'physics').rglob('*.o'))


def test_where_the_package_cannot_be_written_to_the_machine_code_is_kept_in_the_cache(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(machine_code.os, 'access', lambda path, mode: False)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    assert machine_code._object_file().parent == tmp_path / 'cube_sim'
    monkeypatch.delenv('XDG_CACHE_HOME')
    monkeypatch.setenv('HOME', str(tmp_path))
    assert machine_code._object_file().parent == tmp_path / '.cache' / 'cube_sim'
