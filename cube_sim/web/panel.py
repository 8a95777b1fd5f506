"""Panel: settings and switches for all pages, kept as the simulator has them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import viser

from cube_sim.physics import Settings
from cube_sim.physics.models import MODELS
from cube_sim.remote import Answer, SimulatorLink, Status
from cube_sim.simulation import Throwing

KEYS = """\
| key | |
|---|---|
| **W S** (Z S) | forward, back |
| **A D** (Q D) | left, right |
| **E Q** (E A) | up, down |
| arrows, mouse | turn about the point ahead |
| **Space** | throw from here |
| **Tab** | next physics model |
| **R** | remove all cubes |
| **P**, **N** | pause, one step |
| **B** | record a bag |
| **C** | show contacts |
"""


@dataclasses.dataclass(frozen=True)
class _Slider:
    """A parameter as the panel shows it; values beyond `high` widen the slider."""

    label: str
    low: float
    high: float
    step: float


_PHYSICS = {
    'restitution': _Slider('Restitution', 0.0, 1.0, 0.01),
    'friction': _Slider('Friction', 0.0, 1.5, 0.01),
    'tangential_factor': _Slider('Tangential', 0.0, 1.0, 0.01),
    'gravity': _Slider('Gravity', 0.0, 20.0, 0.01),
}
_THROW = {'throw_speed': _Slider('Speed', 0.0, 30.0, 0.1)}
_PACE = {'real_time_factor': _Slider('Time factor', 0.0, 4.0, 0.05)}

PARAMETERS = ('physics_model', 'throw_spin', *_PHYSICS, *_THROW, *_PACE)


class Panel:
    """The controls; what a page changes goes to the simulator, and comes back from there."""

    def __init__(
        self,
        gui: viser.GuiApi,
        link: SimulatorLink,
        throw: Callable[[viser.ClientHandle], None],
        look_for_contacts: Callable[[bool], None],
    ) -> None:
        """
        Build it. `throw` is called for the page whose button is pressed.

        `look_for_contacts` is called with whether the pages show contacts, when that changes.
        """
        self._link = link
        self._inputs: dict[str, Any] = {}
        self._known: dict[str, Any] = {}
        self._wishes: dict[str, tuple[Any, viser.ClientHandle]] = {}
        self._asked: set[str] = set()
        self._shown = ''
        self._status = gui.add_markdown('Looking for the simulator ...')
        with gui.add_folder('Throw'):
            button = gui.add_button('Throw (Space)', icon=viser.Icon.CUBE_SEND)
            self._sliders(gui, _THROW)
            spin = gui.add_vector3(
                'Spin', Throwing().throw_spin, step=0.1, hint=_hint('throw_spin')
            )
            self._inputs['throw_spin'] = spin
        with gui.add_folder('Physics'):
            hint = '; '.join(f'{name}: {model.summary}' for name, model in MODELS.items())
            self._inputs['physics_model'] = gui.add_dropdown('Model', tuple(MODELS), hint=hint)
            self._sliders(gui, _PHYSICS)
            self._contacts: Any = gui.add_checkbox(
                'Contacts (C)', False, hint='Points and normals of the model contact, as lines'
            )
        with gui.add_folder('Run'):
            self._paused: Any = gui.add_checkbox('Paused (P)', False)
            self._sliders(gui, _PACE)
            buttons = gui.add_button_group('', ('Step (N)', 'Reset (R)'))
            self._recording: Any = gui.add_checkbox('Recording (B)', False)
        for name, handle in self._inputs.items():
            handle.on_update(self._changed(name))

        self._contacts.on_update(lambda event: look_for_contacts(event.target.value))

        @button.on_click
        async def _(event: Any) -> None:
            if event.client is not None:
                throw(event.client)

        @buttons.on_click
        async def _(event: Any) -> None:
            self.do('step' if event.target.value.startswith('Step') else 'reset', event.client)

        for switch, service in ((self._paused, 'pause'), (self._recording, 'record')):
            switch.on_update(self._switched(service))

    def do(self, service: str, client: viser.ClientHandle | None) -> None:
        """Call a service for a page, which is told when it is refused; switches are turned."""
        status = self._link.status
        data = {'pause': not status.paused, 'record': not status.bag}.get(service)
        self._do(service, data, client)

    def turn_contacts(self) -> None:
        """Show contacts on all pages, or no longer."""
        self._contacts.value = not self._contacts.value

    def show(self, status: Status, cubes: int, time_ns: int) -> None:
        """Show how the simulator is doing; `cubes` and `time_ns` are those on the stage."""
        self._paused.value = status.paused
        self._recording.value = bool(status.bag)
        if not self._link.present:
            text = f'**{self._link.absence}** It is looked for on and on.'
        else:
            pace = 'paused' if status.paused else f'× {status.factor:.2f}'
            text = f'**{cubes}** cubes · **{time_ns / 1e9:.1f} s** · {pace}'
            text += f'\n\n⏺ `{status.bag}`' if status.bag else ''
            text += f'\n\n⚠ {status.warning}' if status.warning else ''
        if text != self._shown:
            self._shown = text
            self._status.content = text

    def learn(self, values: dict[str, Any]) -> None:
        """Take parameters as the simulator has them."""
        for name, value in values.items():
            if name in self._inputs:
                self._known[name] = value
                if name not in self._asked:
                    self._put(name)

    def _sliders(self, gui: viser.GuiApi, sliders: dict[str, _Slider]) -> None:
        for name, slider in sliders.items():
            self._inputs[name] = gui.add_slider(
                slider.label,
                min=slider.low,
                max=slider.high,
                step=slider.step,
                initial_value=_default(name),
                hint=_hint(name),
            )

    def _changed(self, name: str) -> Callable[[Any], Any]:
        async def callback(event: Any) -> None:
            if event.client is not None:  # not put there by ourselves
                value = event.target.value
                value = list(map(float, value)) if isinstance(value, tuple) else value
                self._wishes[name] = (value, event.client)
                self._ask(name)

        return callback

    def _switched(self, service: str) -> Callable[[Any], Any]:
        async def callback(event: Any) -> None:
            if event.client is not None:
                self._do(service, event.target.value, event.client)

        return callback

    def _do(self, service: str, data: bool | None, client: viser.ClientHandle | None) -> None:
        def done(answer: Answer) -> None:
            if not answer.success and client is not None:
                refuse(client, answer.message)
            self._link.on_change()

        self._link.call(service, done, data)

    def _ask(self, name: str) -> None:
        """Send the latest wish for a parameter, unless one is under way already."""
        if name in self._asked or name not in self._wishes:
            return
        value, client = self._wishes.pop(name)
        self._asked.add(name)

        def done(answer: Answer) -> None:
            self._asked.discard(name)
            if answer.success:
                self._known[name] = value
            else:
                refuse(client, answer.message)
            if name in self._wishes:
                self._ask(name)
            else:
                self._put(name)

        self._link.set_parameter(name, value, done)

    def _put(self, name: str) -> None:
        """Show a parameter as it is known to be."""
        if name not in self._known:
            return
        value, handle = self._known[name], self._inputs[name]
        if name == 'physics_model':
            if value not in handle.options:
                handle.options = (*handle.options, value)
        elif name == 'throw_spin':
            value = tuple(value)
        else:
            handle.max = max(handle.max, value)
            handle.min = min(handle.min, value)
        handle.value = value


def refuse(client: viser.ClientHandle, reason: str) -> None:
    """Tell a page why something was not done."""
    client.add_notification('Not done', reason, auto_close_seconds=5.0, color='red')


def _field(name: str) -> Any:
    for record in (Settings, Throwing):
        if name in record.__dataclass_fields__:
            return record.__dataclass_fields__[name]
    return None


def _default(name: str) -> Any:
    field = _field(name)
    return field.default if field else 1.0


def _hint(name: str) -> str:
    field = _field(name)
    if field is None:
        return 'Simulated seconds for each second of the clock; 0 runs as fast as it can'
    declared = field.metadata['quantity']
    return f'{declared.effect}{f" [{declared.unit}]" if declared.unit else ""}'
