# SPDX-License-Identifier: Apache-2.0
"""
What of a recording survives what machines do to it?

Each row is a recording as a user makes it, to which something happens.  What is missing from its
bag is found by rosbags and the sensors' own stamps, and held against what the recording says:
samples that are missing, wherever they were lost; messages that were published and are not in
the bag; and by how much what was said differs from that.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory

from benchmarks import _survive_long as long
from benchmarks import _survive_rows as rows
from benchmarks._disks import NotPossibleHereError
from benchmarks._frame import Benchmark
from benchmarks._survive_stage import Outcome, SIX, Stage

ROWS: dict[str, Callable[[Stage], Outcome]] = {
    **{f'sources-{n}-busy': partial(rows.beside, bench='sources', loops=n) for n in (0, 2, 4, 8)},
    **{f'six-{n}-busy': partial(rows.beside, bench=SIX, loops=n) for n in (0, 2, 4, 8)},
    'stopped-3': partial(rows.stopped, seconds=3.0),
    'stopped-10': partial(rows.stopped, seconds=10.0),
    'killed': rows.killed,
    'disk-full': rows.disk_full,
    'disk-slow': rows.disk_slow,
    'clock': rows.clock_jumps,
    'memory': rows.little_memory,
    'suspended': rows.suspended,
    'one-core': partial(rows.one_core, rights=True),
    'one-core-user': partial(rows.one_core, rights=False),
    'user': rows.ordinary_user,
    'eight': rows.eight,
    'half-hour': long.steady,
    'day': long.day,
}

MAY_LOSE = ('sources-8-busy', 'six-8-busy', 'disk-full', 'memory', 'one-core', 'one-core-user')
"""Rows in which messages may be lost on the way, if they are counted."""

QUICK = ('stopped-3',)


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--seconds', 30.0, quick=3.0, help='of a recording')
    bench.add_size('--kills', 20, quick=1, help='recordings in which something is killed')
    bench.add_size('--suspended', 60.0, quick=5.0, help='seconds for which everything is stopped')
    bench.add_argument('--seed', type=int, default=25, help='of the times of the kills')
    bench.add_argument(
        '--only', action='append', choices=ROWS, metavar='ROW',
        help=f'this row, may be repeated (default all, with --quick {" and ".join(QUICK)}): '
        + ', '.join(ROWS),
    )  # fmt: skip
    options = bench.start()
    names = options.only or (QUICK if bench.quick else tuple(ROWS))
    widest = max(map(len, names))
    bench.head(f'{"row":{widest}}', 'samples', 'missing', 'on the way', 'not said', 'exit', 'load')
    for name in names:
        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            stage = Stage(
                Path(folder),
                options.seconds,
                bench.quick,
                options.kills,
                options.suspended,
                options.seed,
            )
            try:
                outcome = ROWS[name](stage)
            except NotPossibleHereError as reason:
                bench.row(name, '-', '-', '-', '-', '-', '-')
                print(f'    cannot be tried here: {reason}')
                bench.claim(f'{name}: tried', 0, at_least=1)
                continue
            except (RuntimeError, TimeoutError) as failure:
                outcome = Outcome(problems=[str(failure)])
        show(bench, name, outcome)
    return bench.done()


def show(bench: Benchmark, name: str, outcome: Outcome) -> None:
    """Print a row, and claim what it promises."""
    bench.row(
        name, outcome.samples, outcome.missing, outcome.on_the_way, outcome.unsaid,
        '-' if outcome.code is None else outcome.code, f'{os.getloadavg()[0]:.1f}',
    )  # fmt: skip
    for line in (*outcome.remarks, *(f'PROBLEM: {each}' for each in outcome.problems)):
        print(f'    {line}', flush=True)
    if name not in MAY_LOSE:
        bench.claim(f'{name}: lost on the way', outcome.on_the_way, at_most=0)
    bench.claim(f'{name}: lost and not said', outcome.unsaid, at_most=0)
    bench.claim(f'{name}: problems', len(outcome.problems), at_most=0)


if __name__ == '__main__':
    sys.exit(main())
