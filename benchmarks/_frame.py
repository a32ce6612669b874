# SPDX-License-Identifier: Apache-2.0
"""
What every benchmark shares: its options, tables and claims, and the machine it ran on.

A benchmark is a file in this folder with a docstring, which ``--help`` prints, and ``main``::

    def main() -> int:
        bench = Benchmark(__doc__)
        bench.add_size('--runs', 200, quick=5, help='records of each kind')
        options = bench.start()
        bench.head('method', 'bias')
        bias = measure(options.runs)
        bench.row('fit', f'{bias:.1f} %')
        bench.claim('bias of the fit', abs(bias), at_most=1.0, unit='%')
        return bench.done()


    if __name__ == '__main__':
        sys.exit(main())
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
import json
import math
import os
from pathlib import Path
import sys
import time
from typing import Any


@dataclass(frozen=True)
class Claim:
    """A measured value, and the interval in which it is claimed to be."""

    name: str
    value: float
    low: float
    high: float
    unit: str

    @property
    def met(self) -> bool:
        """Whether the value is inside; what is not a number is not."""
        return self.low <= self.value <= self.high

    @property
    def verdict(self) -> str:
        """'met' or 'NOT MET'."""
        return 'met' if self.met else 'NOT MET'

    @property
    def measured(self) -> str:
        """The value as text, with the unit."""
        digits = ',.0f' if self.value.is_integer() else '.4g'
        return f'{self.value:{digits}} {self.unit}'.strip()

    @property
    def target(self) -> str:
        """The interval as text, without the unit."""
        if self.low == self.high:
            return f'= {self.low:g}'
        if math.isinf(self.high):
            return f'≥ {self.low:g}'
        return f'≤ {self.high:g}' if math.isinf(self.low) else f'{self.low:g} to {self.high:g}'


class Benchmark:
    """One run of one benchmark, from its command line to its exit code."""

    def __init__(self, doc: str | None) -> None:
        self.name = Path(sys.argv[0]).stem
        self.claims: list[Claim] = []
        self.stored: dict[str, Any] = {}  # figures that nothing is claimed of
        self.quick = False
        self._json: Path | None = None
        self._sizes: dict[str, tuple[float, float]] = {}
        self._options: dict[str, Any] = {}
        self._widths: list[int] = []
        self._began, self._load = time.perf_counter(), os.getloadavg()[0]
        self._parser = argparse.ArgumentParser(
            prog=f'./run benchmark {self.name}',
            description=doc,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self.add_argument = self._parser.add_argument
        self.error = self._parser.error
        self.add_argument(
            '--quick', action='store_true',
            help='small sizes, a few seconds: shows that it runs, and proves no claim',
        )  # fmt: skip
        self.add_argument(
            '--json', type=Path, metavar='FILE',
            help=f'write the claims and the machine there; in a folder, as {self.name}.json',
        )  # fmt: skip

    def add_size(self, option: str, full: float, *, quick: float, help: str) -> None:
        """Add an option, a number of the type of `full`, that is smaller with ``--quick``."""
        name = self.add_argument(
            option, type=type(full), metavar='N',
            help=f'{help} (default {full:g}; with --quick {quick:g})',
        ).dest  # fmt: skip
        self._sizes[name] = full, quick

    def start(self) -> argparse.Namespace:
        """Read the command line, print what is run on which machine, and return the options."""
        options = self._parser.parse_args()
        self.quick, self._json = options.quick, options.json
        for name, (full, quick) in self._sizes.items():
            if getattr(options, name) is None:
                setattr(options, name, quick if self.quick else full)
            if not getattr(options, name) > 0:
                self._parser.error(f'--{name.replace("_", "-")} must be more than 0')
        self._options = {k: v for k, v in vars(options).items() if k not in ('quick', 'json')}
        chosen = ''.join(
            f', {name} {value}' for name, value in self._options.items() if value is not None
        )
        kind = 'quick run' if self.quick else 'full run'
        print(f'{self.name}: {kind} on {cores()} cores, load average {self._load:.2f}{chosen}')
        return options

    def head(self, *columns: str, title: str = '') -> None:
        """Begin a table."""
        print(f'\n{title}\n' if title else '')
        self._widths = [max(3, len(column)) for column in columns]
        self.row(*columns)
        print('|' + ''.join('-' * (width + 2) + '|' for width in self._widths))

    def row(self, *cells: object) -> None:
        """Print a row of the table begun last; numbers are to be formatted by who knows them."""
        padded = (f' {cell!s:{width}} |' for cell, width in zip(cells, self._widths, strict=True))
        print('|' + ''.join(padded), flush=True)

    def claim(
        self,
        name: str,
        value: float,
        *,
        at_least: float = -math.inf,
        at_most: float = math.inf,
        unit: str = '',
    ) -> None:
        """Hold a measured value against its target; `done` prints the verdict."""
        if math.isinf(at_least) and math.isinf(at_most):
            raise ValueError(f'claim {name!r} needs a target: at_least, at_most or both')
        self.claims.append(Claim(name, float(value), at_least, at_most, unit))

    def done(self) -> int:
        """Print the claims, write the JSON document, and return 1 if one is not met, else 0."""
        if not self.claims:
            raise ValueError(f'benchmark {self.name} claims nothing')
        measured = [claim.measured for claim in self.claims]
        widest = max(len(claim.name) for claim in self.claims), max(map(len, measured))
        self.head(f'{"claim":{widest[0]}}', f'{"measured":{widest[1]}}', 'target', 'verdict')
        for claim, value in zip(self.claims, measured, strict=True):
            self.row(claim.name, value, claim.target, claim.verdict)
        seconds = time.perf_counter() - self._began
        print(f'\n{seconds:.0f} s, load average afterwards {os.getloadavg()[0]:.2f}')
        if self._json is not None:
            path = self._json / f'{self.name}.json' if self._json.is_dir() else self._json
            path.write_text(json.dumps(self._document(seconds), indent=2) + '\n', 'utf-8')
        return 0 if all(claim.met for claim in self.claims) else 1

    def _document(self, seconds: float) -> dict[str, Any]:
        return {
            'benchmark': self.name,
            'quick': self.quick,
            'options': {
                name: str(value) if isinstance(value, Path) else value
                for name, value in self._options.items()
            },
            'cores': cores(),
            'load_average': {'before': self._load, 'after': os.getloadavg()[0]},
            'seconds': seconds,
            **self.stored,
            'claims': [
                {
                    'name': claim.name,
                    'value': claim.value if math.isfinite(claim.value) else str(claim.value),
                    'unit': claim.unit,
                    'target': claim.target,
                    'verdict': claim.verdict,
                }
                for claim in self.claims
            ],
        }


def cores() -> int:
    """Return on how many cores this process may run."""
    return len(os.sched_getaffinity(0))
