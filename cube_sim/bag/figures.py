"""The figures of `cube_bag report`: heights, energy, a map of the bounces, a phase portrait."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis import trace
from cube_sim.analysis.findings import Findings
from cube_sim.recording import RecordingError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

# Up to so many cubes each gets a line and a colour; more are shown as a crowd.
SINGLES = 12
# Lines of a crowd that are drawn at all: more would only make it black.
CROWD = 300

_INK = '#1f2933'
_BLUE = '#2166ac'
# Potential, translation, rotation: apart also for the colour-blind (Okabe and Ito).
_ENERGIES = (('potential', '#56b4e9'), ('translation', '#e69f00'), ('rotation', '#009e73'))
_SIZE = (9.0, 4.5)


def figures(found: Findings) -> dict[str, Figure]:
    """Return the figures by name; RecordingError when matplotlib is missing."""
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError:
        raise RecordingError(
            'Figures need matplotlib: install it with pip install matplotlib.'
        ) from None
    draw: dict[str, Callable[[Findings, Figure], None]] = {
        'height': _draw_heights,
        'energy': _draw_energy,
        'bounces': _draw_map,
        'phase': _draw_phase,
    }
    if 1 < len(found.cubes) <= SINGLES:
        draw['energy_by_cube'] = _draw_energy_by_cube
    style: Any = {
        'font.size': 10,
        'axes.edgecolor': '#9aa5b1',
        'axes.labelcolor': _INK,
        'text.color': _INK,
        'xtick.color': _INK,
        'ytick.color': _INK,
        'axes.spines.top': False,
        'axes.spines.right': False,
        'axes.grid': True,
        'grid.color': '#d9e0e7',
        'grid.linewidth': 0.6,
        'axes.axisbelow': True,
    }
    drawn = {}
    with mpl.rc_context(style):
        for name, function in draw.items():
            figure = Figure(figsize=_SIZE, layout='constrained')
            function(found, figure)
            drawn[name] = figure
    return drawn


def save_figures(found: Findings, folder: Path) -> list[Path]:
    """Write every figure as PNG and SVG into `folder` and return the paths; RecordingError."""
    paths = []
    drawn = figures(found)
    import matplotlib as mpl

    try:
        folder.mkdir(parents=True, exist_ok=True)
        # The same findings are drawn as the same bytes.
        with mpl.rc_context({'svg.hashsalt': 'cube_sim'}):
            for name, figure in drawn.items():
                for suffix, metadata in (('png', None), ('svg', {'Date': None})):
                    path = folder / f'{name}.{suffix}'
                    figure.savefig(path, dpi=150, metadata=metadata)
                    paths.append(path)
    except OSError as error:
        raise RecordingError(f'{folder} cannot be written: {error.strerror}.') from None
    return paths


def png(figure: Figure) -> bytes:
    """Return a figure as the bytes of a PNG."""
    memory = io.BytesIO()
    figure.savefig(memory, format='png', dpi=130)
    return memory.getvalue()


def _draw_heights(found: Findings, figure: Figure) -> None:
    axes = figure.add_subplot()
    axes.set(xlabel='time, s', ylabel='height of the centre, m')
    if len(found.cubes) <= SINGLES:
        for label, color, times, cubes in _lines(found):
            axes.plot(times, cubes[:, trace.Z], color=color, linewidth=1.3, label=label)
        _cube_legend(figure, axes)
    else:
        _draw_crowd(found, axes)
        _legend_above(axes, 4)
    _from_zero(axes)
    _mark_resets(found, axes)


def _draw_crowd(found: Findings, axes: Axes) -> None:
    """Draw every cube faintly, and the middle of them all."""
    for _, _, times, cubes in _lines(found):
        axes.plot(times, cubes[:, trace.Z], color=_BLUE, alpha=0.12, linewidth=0.5)
    first = True
    for times, cubes in _generations(found):
        present = np.isfinite(cubes[:, :, trace.Z]).any(axis=1)
        heights = cubes[present][:, :, trace.Z]
        if not len(heights):
            continue
        low, quarter, median, three, high = np.nanpercentile(heights, (5, 25, 50, 75, 95), axis=1)
        at = times[present]
        # Labels once, not for each generation.
        words = ('5 % to 95 %', '25 % to 75 %', 'median') if first else ('', '', '')
        axes.fill_between(at, low, high, color='#92c5de', alpha=0.45, linewidth=0, label=words[0])
        axes.fill_between(at, quarter, three, color='#4393c3', alpha=0.55, lw=0, label=words[1])
        axes.plot(at, median, color='#053061', linewidth=1.5, label=words[2])
        first = False
    axes.plot([], [], color=_BLUE, alpha=0.5, linewidth=0.8, label='one cube')


def _draw_energy(found: Findings, figure: Figure) -> None:
    axes = figure.add_subplot()
    axes.set(xlabel='time, s', ylabel='energy of all cubes, J')
    frames = found.trace.frames
    times = np.array([frame.time_ns for frame in frames]) / 1e9
    if len(frames):
        split = np.array([frame.energies for frame in frames]).T
        _stack(axes, times, split)
        thrown = _thrown_until(found, times)
        axes.plot(
            times, thrown, color=_INK, linewidth=1.1, linestyle=(0, (4, 2)), label='thrown in'
        )
    _from_zero(axes)
    _mark_resets(found, axes)
    _legend_above(axes, 4)


def _draw_energy_by_cube(found: Findings, figure: Figure) -> None:
    lines = list(_lines(found))
    columns = min(4, len(lines))
    rows = -(-len(lines) // columns)
    figure.set_size_inches(_SIZE[0], 1.9 * rows + 0.8)
    grid: Any = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(lines) :]:
        axes.set_visible(False)
    for axes, (label, _, times, cubes) in zip(grid.flat, lines, strict=False):
        _stack(axes, times, cubes[:, trace.POTENTIAL :].T)
        axes.set_title(f'cube {label}', fontsize=9, loc='left')
    # They share one axis: it is set once all have been drawn.
    _from_zero(grid.flat[0])
    figure.supxlabel('time, s', fontsize=10)
    figure.supylabel('energy, J', fontsize=10)
    handles, labels = grid.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper right', ncols=3, frameon=False)


def _stack(axes: Axes, times: Floats, split: Floats) -> None:
    axes.stackplot(
        times,
        np.nan_to_num(split),
        labels=[words for words, _ in _ENERGIES],
        colors=[color for _, color in _ENERGIES],
        linewidth=0,
    )
    axes.margins(x=0.01)


def _draw_map(found: Findings, figure: Figure) -> None:
    axes = figure.add_subplot()
    axes.set(xlabel='x, m', ylabel='y, m', aspect='equal')
    axes.set_adjustable('datalim')
    faint = 0.5 if len(found.cubes) <= SINGLES else 0.15
    for _, _, _, cubes in _lines(found):
        axes.plot(cubes[:, trace.X], cubes[:, trace.Y], color='#7b8794', alpha=faint, linewidth=0.7)
    thrown = found.cubes.records['pose']
    few = len(thrown) <= SINGLES
    axes.scatter(
        thrown[:, 0],
        thrown[:, 1],
        marker='^',
        s=34 if few else 10,
        color=_INK,
        linewidths=0,
        label='throw',
        zorder=4,
    )
    bounces = found.bounces.records
    if len(bounces):
        speeds = found.measures().impact_speed
        order = np.argsort(speeds)
        places = (bounces['position'] + bounces['arm'])[order]
        dots = axes.scatter(
            places[:, 0],
            places[:, 1],
            c=speeds[order],
            s=22 if len(bounces) < 1000 else 6,
            cmap='viridis_r',
            edgecolors='white',
            linewidths=0.3 if len(bounces) < 1000 else 0.0,
            # Thousands of dots as shapes make an SVG that nothing can show.
            rasterized=len(bounces) >= 1000,
            label='bounce',
            zorder=3,
        )
        bar = figure.colorbar(dots, ax=axes, shrink=0.85, pad=0.02)
        bar.set_label('impact speed of the contact point, m/s')
        bar.outline.set_visible(False)
    _legend_above(axes, 2)


def _draw_phase(found: Findings, figure: Figure) -> None:
    axes = figure.add_subplot()
    axes.set(xlabel='height of the centre, m', ylabel='vertical velocity, m/s')
    axes.axhline(0.0, color='#9aa5b1', linewidth=0.8)
    if len(found.cubes) <= SINGLES:
        for label, color, _, cubes in _lines(found):
            axes.plot(
                cubes[:, trace.Z],
                cubes[:, trace.VZ],
                color=color,
                linewidth=0.8,
                marker='.',
                markersize=2.5,
                label=label,
            )
        _cube_legend(figure, axes)
        return
    points = [frame.cubes[:, [trace.Z, trace.VZ]] for frame in found.trace.frames]
    both = np.concatenate(points)
    both = both[np.isfinite(both).all(axis=1)]
    cells = axes.hexbin(
        both[:, 0],
        both[:, 1],
        gridsize=(110, 60),
        bins='log',
        mincnt=1,
        cmap='Blues',
        linewidths=0,
        vmin=0.1,
    )
    bar = figure.colorbar(cells, ax=axes, shrink=0.85, pad=0.02)
    bar.set_label('poses of all cubes')
    bar.outline.set_visible(False)


def _generations(found: Findings) -> Iterator[tuple[Floats, Floats]]:
    """Yield times (F,), s, and cubes (F, N, 7) between two resets, nan before a cube is there."""
    for frames in found.trace.generations():
        count = max(len(frame.cubes) for frame in frames)
        cubes = np.full((len(frames), count, 7), np.nan)
        for row, frame in enumerate(frames):
            cubes[row, : len(frame.cubes)] = frame.cubes
        yield np.array([frame.time_ns for frame in frames]) / 1e9, cubes


def _lines(found: Findings) -> Iterator[tuple[str, Any, Floats, Floats]]:
    """Yield label, colour, times (F,) and values (F, 7) of each cube, of a crowd only some."""
    many = bool(found.resets_ns)
    stride = max(1, -(-len(found.cubes) // CROWD))
    number = 0
    for generation, (times, cubes) in enumerate(_generations(found)):
        for cube in range(0, cubes.shape[1], stride):
            there = np.isfinite(cubes[:, cube, trace.Z])
            if there.any():
                label = f'{generation}:{cube}' if many else str(cube)
                yield label, _color(number), times[there], cubes[there, cube]
                number += 1


def _color(number: int) -> Any:
    import matplotlib as mpl

    return mpl.colormaps['tab20'].colors[(2 * number + number // 10) % 20]  # type: ignore[attr-defined]


def _thrown_until(found: Findings, times: Floats) -> Floats:
    """Return what has been thrown in until each time, and not been taken away since, J."""
    total = np.zeros(len(times))
    for cube in found.cubes.records:
        there = times >= cube['thrown_ns'] / 1e9
        if cube['removed']:
            there &= times <= cube['ended_ns'] / 1e9
        total[there] += np.nansum(cube['thrown_energy'])
    return total


def _mark_resets(found: Findings, axes: Axes) -> None:
    for time_ns in found.resets_ns:
        axes.axvline(time_ns / 1e9, color='#ba2525', linewidth=0.9, linestyle=':')
    if found.resets_ns:
        axes.plot([], [], color='#ba2525', linewidth=0.9, linestyle=':', label='reset')


def _from_zero(axes: Axes) -> None:
    """Begin the height or energy at 0, if it is never below."""
    if axes.get_ylim()[0] > -0.05 * axes.get_ylim()[1]:
        axes.set_ylim(bottom=0.0)


def _cube_legend(figure: Figure, axes: Axes) -> None:
    """Name the cubes beside the axes, where no line runs."""
    handles, labels = axes.get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, title='cube', loc='outside right upper', frameon=False)


def _legend_above(axes: Axes, columns: int) -> None:
    """Put the legend above the axes, where it covers nothing."""
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        axes.legend(
            handles,
            labels,
            loc='lower left',
            bbox_to_anchor=(0.0, 1.0),
            ncols=columns + 1,
            frameon=False,
            borderaxespad=0.2,
        )
