"""
How well poses alone tell what happened: `python benchmarks/estimation.py [CUBES]`.

Records thrown cubes under both models at 50 and 200 poses a second, estimates their bounces from
the poses, simulates the same bags again step by step, and prints the differences as a Markdown
table: the median (bias) and the range that holds nine of ten. `cube_sim.analysis.error_bars` has
its numbers from here.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / 'test'))

from support.bags import record_run, throws

from cube_sim.analysis.findings import Findings
from cube_sim.analysis.run import find_out
from cube_sim.recording.reader import BagReader

SECONDS = 4.0


def differences(exact: Findings, estimated: Findings) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield quantity, unit and differences, for the bounces that were found."""
    ours, theirs = estimated.bounces.records, exact.bounces.records
    pairs = list(matches(exact, estimated))
    mine, true = (np.array(column, int) for column in zip(*pairs, strict=True))
    yield 'time', 'ms', (ours['time_ns'][mine] - theirs['time_ns'][true]) / 1e6
    place = ours['position'][mine] + ours['arm'][mine]
    true_place = theirs['position'][true] + theirs['arm'][true]
    yield (
        'place of the contact',
        'mm',
        1e3 * np.linalg.norm((place - true_place)[:, :2], axis=1),
    )
    measured, known = estimated.measures(), exact.measures()
    simple = estimated.settings[0].model == 'simple'
    for words, name in (
        ('impact speed', 'centre_impact_speed' if simple else 'impact_speed'),
        ('rebound speed', 'centre_rebound_speed' if simple else 'rebound_speed'),
    ):
        yield words, 'm/s', getattr(measured, name)[mine] - getattr(known, name)[true]
    yield 'restitution', '', measured.restitution[mine] - known.restitution[true]
    if simple:
        kept, true_kept = measured.tangential_factor[mine], known.tangential_factor[true]
        yield 'tangential factor', '', kept - true_kept
    else:
        certain = ~measured.friction_is_bound[mine] & ~known.friction_is_bound[true]
        yield 'friction', '', (measured.friction[mine] - known.friction[true])[certain]
    spin = ours['after'][mine, 3:] - theirs['after'][true, 3:]
    yield 'spin', 'rad/s', np.linalg.norm(spin, axis=1)


def matches(exact: Findings, estimated: Findings) -> Iterator[tuple[int, int]]:
    """Yield the indices of bounces that are one and the same."""
    theirs = exact.bounces.records
    for index, bounce in enumerate(estimated.bounces.records):
        apart = np.abs(theirs['time_ns'] - bounce['time_ns'])
        apart = np.where(theirs['cube'] == bounce['cube'], apart, np.iinfo(np.int64).max)
        nearest = int(apart.argmin())
        if apart[nearest] <= estimated.period_ns:
            yield index, nearest


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print('| model | poses/s | found | quantity | bias | nine of ten |')
    print('|---|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as folder:
        for model in ('simple', 'impulse'):
            for rate in (50, 200):
                bag = Path(folder) / f'{model}_{rate}'
                # 5 ms are no whole number of the product's own steps of 2 ms.
                step_ns = 2_000_000 if rate == 50 else 2_500_000
                record_run(
                    bag,
                    throws(count, every=0.01),
                    SECONDS,
                    period=round(1e9 / rate) // step_ns,
                    model=model,
                    time_step_ns=step_ns,
                )
                with BagReader(bag) as reader:
                    exact = find_out(reader)
                    estimated = find_out(reader, from_poses=True)
                found = f'{len(estimated.bounces)} of {len(exact.bounces)}'
                for quantity, unit, values in differences(exact, estimated):
                    values = values[np.isfinite(values)]
                    low, bias, high = np.percentile(values, (5, 50, 95))
                    print(
                        f'| {model} | {rate} | {found} | {quantity} | {bias:.2g} {unit} '
                        f'| {low:.2g} to {high:.2g} {unit} |'
                    )


if __name__ == '__main__':
    main()
