"""Scenarios: YAML lists of timed throws, settings, camera poses and resets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from cube_sim.physics.refusal import PhysicsError
from cube_sim.physics.settings import Settings
from cube_sim.simulation.camera import Camera
from cube_sim.simulation.parameters import CHANGEABLE, settings_with, throwing_with
from cube_sim.simulation.throwing import Throwing

Vector = tuple[float, float, float]

# What an entry can do, and the keys that it then may have.
ACTIONS: dict[str, tuple[str, ...]] = {
    'camera': ('position', 'orientation'),
    'throw': ('speed', 'spin'),
    'set': CHANGEABLE,
    'reset': (),
}

# The latest time of an entry, s: thirty years.
LONGEST = 1e9

# The C loader is ten times as fast; PyYAML can be built without it.
_Loader: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)

_PACKAGED = Path(__file__).parent.parent / 'scenarios'


class ScenarioError(ValueError):
    """A scenario that cannot be played; the message gives file, line and what is allowed."""


@dataclass(frozen=True)
class Place:
    """Puts the camera somewhere; None leaves that part as it is."""

    position: Vector | None
    orientation: tuple[float, float, float, float] | None


@dataclass(frozen=True)
class Throw:
    """Throws a cube; None takes `throw_speed` or `throw_spin`."""

    speed: float | None
    spin: Vector | None


@dataclass(frozen=True)
class Set:
    """Changes parameters, by their ROS names."""

    values: Mapping[str, Any]


@dataclass(frozen=True)
class Reset:
    """Removes all cubes."""


Action = Place | Throw | Set | Reset


@dataclass(frozen=True)
class Entry:
    """An action, its time (ns since the start), and where it is written."""

    time_ns: int
    action: Action
    line: int


@dataclass(frozen=True)
class Scenario:
    """Entries in the order of their times; those of one time in the order of the file."""

    name: str
    entries: tuple[Entry, ...] = ()

    @classmethod
    def load(cls, path: str | Path) -> Scenario:
        """
        Read a scenario: a file, or the name of one that comes with the package.

        ScenarioError when there is none or it cannot be played, with file and line.
        """
        file = _file_of(path)
        try:
            text = file.read_text(encoding='utf-8')
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError(f'{file}: cannot be read as text ({error}).') from None
        return cls.parse(text, str(file))

    @classmethod
    def parse(cls, text: str, name: str = 'scenario') -> Scenario:
        """Read a scenario from its YAML; `name` stands for the file in error messages."""
        try:
            root = yaml.compose(text, _Loader)
        except yaml.YAMLError as error:
            mark = getattr(error, 'problem_mark', None)
            line = f':{mark.line + 1}' if mark else ''
            problem = getattr(error, 'problem', None) or str(error)
            raise ScenarioError(f'{name}{line}: this is not YAML ({problem}).') from None
        if root is None:
            return cls(name)
        reader = _Reader(name)
        if not isinstance(root, yaml.SequenceNode):
            raise reader.error(root, 'a list of entries like "- {at: 0.0, throw: {}}" is needed')
        entries = [reader.entry(node) for node in root.value]
        return cls(name, tuple(sorted(entries, key=lambda entry: entry.time_ns)))


def packaged_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package, by name."""
    return {path.stem: path for path in sorted(_PACKAGED.glob('*.yaml'))}


def _file_of(path: str | Path) -> Path:
    try:
        file = Path(path).expanduser()
    except RuntimeError as error:  # "~" of a user that is not there
        raise ScenarioError(f'{path}: {error}') from None
    if file.is_file():
        return file
    packaged = packaged_scenarios()
    if str(path) in packaged:
        return packaged[str(path)]
    raise ScenarioError(
        f'{path}: there is no such file, and no scenario of that name; '
        f'there are: {", ".join(packaged)}.'
    )


class _Reader:
    """Turns YAML nodes into entries; every error knows its line."""

    def __init__(self, name: str) -> None:
        self._name = name

    def error(self, node: yaml.Node, problem: str) -> ScenarioError:
        return ScenarioError(f'{self._name}:{node.start_mark.line + 1}: {problem}.')

    def entry(self, node: yaml.Node) -> Entry:
        keys = self._mapping(node, ('at', *ACTIONS), 'an entry')
        actions = [key for key in keys if key in ACTIONS]
        if 'at' not in keys or len(actions) != 1:
            raise self.error(node, f'an entry needs "at" and exactly one of {", ".join(ACTIONS)}')
        at = self._number(keys['at'], 'at')
        if not 0.0 <= at <= LONGEST:
            raise self.error(keys['at'], f'at is {at}: seconds from 0 to {LONGEST:g} are needed')
        name = actions[0]
        values = self._mapping(keys[name], ACTIONS[name], f'"{name}"')
        action = self._action(name, keys[name], values)
        return Entry(round(at * 1e9), action, node.start_mark.line + 1)

    def _action(self, name: str, node: yaml.Node, values: dict[str, yaml.Node]) -> Action:
        # What the values must be is said once, by the records that will take them.
        try:
            if name == 'throw':
                speed = self._number(values['speed'], 'speed') if 'speed' in values else None
                spin = self._vector(values['spin'], 'spin', 3) if 'spin' in values else None
                taken = {'throw_speed': speed, 'throw_spin': spin}
                throwing_with(Throwing(), {k: v for k, v in taken.items() if v is not None})
                return Throw(speed, spin)
            if name == 'camera':
                place: Any = self._vector(values.get('position'), 'position', 3)
                turn: Any = self._vector(values.get('orientation'), 'orientation', 4)
                Camera(place or (0.0, 0.0, 0.0), turn or (0.0, 0.0, 0.0, 1.0))
                return Place(place, turn)
            if name == 'set':
                changes = {key: self._plain(value) for key, value in values.items()}
                settings_with(Settings(), changes)
                throwing_with(Throwing(), changes)
                return Set(changes)
        except PhysicsError as error:
            raise self.error(node, str(error).rstrip('.')) from None
        return Reset()

    def _mapping(self, node: yaml.Node, allowed: Iterable[str], what: str) -> dict[str, yaml.Node]:
        if isinstance(node, yaml.ScalarNode) and node.value in ('', 'null', '~'):
            return {}
        if not isinstance(node, yaml.MappingNode):
            raise self.error(node, f'{what} needs a mapping, like "{{}}"')
        found: dict[str, yaml.Node] = {}
        for key, value in node.value:
            if key.value not in allowed:
                raise self.error(
                    key, f'{what} has no {key.value!r}; allowed: {", ".join(allowed) or "nothing"}'
                )
            if key.value in found:
                raise self.error(key, f'{what} has {key.value!r} twice')
            found[key.value] = value
        return found

    def _plain(self, node: yaml.Node) -> Any:
        try:
            value = yaml.SafeLoader('').construct_object(node, deep=True)
        except (yaml.YAMLError, ValueError):  # a foreign tag, the 99th of a month
            raise self.error(node, 'a plain YAML value is needed') from None
        # YAML 1.1 reads 1e3 as text.
        if isinstance(value, str):
            try:
                return float(value)
            except ValueError:
                return value
        return value

    def _number(self, node: yaml.Node, name: str) -> float:
        value = self._plain(node)
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            raise self.error(node, f'{name} is {value!r}: a number is needed')
        return float(value)

    def _vector(self, node: yaml.Node | None, name: str, length: int) -> Any:
        if node is None:
            return None
        if not isinstance(node, yaml.SequenceNode) or len(node.value) != length:
            raise self.error(node, f'{name} needs a list of {length} numbers')
        return tuple(self._number(item, name) for item in node.value)
