# SPDX-License-Identifier: Apache-2.0
"""
Would a wrong constant in a driver be found?  Each is changed, one at a time, and tried.

Addresses, identities, bits, codes, scales, offsets, byte orders, axes, limits, waits and what
sequences write: the class of the driver is changed in this process.  First the second sources are
asked (test/oracles), then the tests of the chip that look at what was changed, the quickest first,
until one fails.  Emulators take the same constants, so many tests cannot see them wrong.

Claimed is that no change survives that a second source could have caught; the others are listed,
and docs/drivers_second_sources.md says why.  ``--part 2/5`` tries the second of five parts.
Of a sample of the changes, always the same, a smaller ``--most`` and a quick run ask; a quick run
takes only the tests that all drivers share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from importlib.util import module_from_spec, spec_from_file_location
from io import StringIO
from pathlib import Path
from random import Random
import signal
import sys
import time
from types import FrameType
from typing import Any, NamedTuple

from imu_bench import drivers
from imu_bench.registers import Identity, Until, Wait, Write
from imu_bench.registers.fields import Declaration
import pytest

from benchmarks._driver_mutants import forget, Mutant, mutants
from benchmarks._frame import Benchmark

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT / 'test' / 'drivers' / 'test_sequences.py', ROOT / 'test' / 'test_every_driver.py'
"""Tests of all drivers; those of one have its name in brackets."""

PATIENCE = 20.0
"""A test that computes so many times longer than usual, and at least so many seconds, failed."""

LONGEST_WAIT_S = 120.0
"""One that waits for so long, whatever it computes, failed too."""

LONGEST_S = 0.3
"""Tests that take longer, with nothing changed, are left out: nine of ten take less."""


# --- who notices -------------------------------------------------------------------------
class Sources:
    """The second sources, read once; they say what they say whatever the driver becomes."""

    def __init__(self, name: str) -> None:
        spec = spec_from_file_location('oracles', ROOT / 'test' / 'test_oracles.py')
        if spec is None or spec.loader is None:
            raise FileNotFoundError('test/test_oracles.py')
        self._test = module_from_spec(spec)
        spec.loader.exec_module(self._test)
        self._driver = drivers.load(name)
        self._stated = {
            (table, fact): (value, within)
            for table in self._test.of(name)
            for fact, value, within in self._test.stated(table)
        }
        facts: set[str] = set(self._test.declared(self._driver))
        self._heard = facts & {fact for _, fact in self._stated}

    def notice(self) -> bool:
        """Return whether the driver, as it is now, says something else than a source."""
        ours = self._test.declared(self._driver)
        return any(
            (fact not in ours or not self._test.agrees(ours[fact], value, within))
            for (table, fact), (value, within) in self._stated.items()
            if (table, fact) not in self._test.DISPUTED
        )

    def could_notice(self, mutant: Mutant) -> bool:
        """Return whether a source states what the mutant changes."""
        return mutant.what in self._heard


@contextmanager
def _looked_at(found: set[tuple[int, str]], declared: Iterable[Any]) -> Iterator[None]:
    """Collect which attributes of which declarations are asked for meanwhile."""

    def asked(self: Any, name: str) -> Any:
        found.add((id(self), name))
        return object.__getattribute__(self, name)

    for declaration in declared:
        forget(declaration)
    kinds = Declaration, Identity, Wait, Write, Until
    for kind in kinds:
        kind.__getattribute__ = asked  # type: ignore[method-assign]
    try:
        yield
    finally:
        for kind in kinds:
            del kind.__getattribute__


class Tests:
    """The tests of a chip, collected once by pytest, and run again and again."""

    def __init__(self, name: str, *, quick: bool) -> None:
        self._name = name
        self._quick = quick
        self._seconds: dict[str, float] = {}
        self._items: list[pytest.Item] = []
        self._looks: dict[str, set[tuple[int, str]]] = {}

    def run(self, work: Callable[[], None]) -> int:
        """Let pytest collect, then do the work; `notice` is for use in there."""
        self._work = work
        own = [
            *ROOT.glob(f'test/drivers/test_{self._name}*.py'),
            *ROOT.glob(f'test/emulators/test_{self._name}*.py'),
            *ROOT.glob(f'test/emulators/{self._name}/test_*.py'),
        ]
        files = [*([] if self._quick else own), *SHARED]
        options = ['-q', '-p', 'no:cacheprovider', '-m', 'not slow', '-k', 'not imports_without']
        # what pytest says of a failure is thrown away, and costs more than most tests
        options.append('--tb=native')
        return int(pytest.main([*options, *map(str, files)], plugins=[self]))

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run what matters once, as a measure, then the work instead of the tests."""
        for item in session.items:
            if item.path not in SHARED or f'[{self._name}' in item.nodeid:
                began = time.process_time()
                if not self._passes(item):
                    print(f'{item.nodeid} fails with nothing changed: left out', flush=True)
                    continue
                self._seconds[item.nodeid] = seconds = time.process_time() - began
                if seconds < (LONGEST_S / 2 if self._quick else LONGEST_S):
                    self._items.append(item)
                    looks = self._looks[item.nodeid] = set()
                    with _looked_at(
                        looks, drivers.load(self._name).declared(Declaration).values()
                    ):
                        self._passes(item)
        self._items.sort(key=lambda item: self._seconds[item.nodeid])
        self._work()
        return True

    def notice(self, mutant: Mutant) -> str:
        """Return the first test that fails, '' if none does; those that do not look cannot."""
        for item in self._items:
            looks = id(mutant.declares), mutant.attribute
            if mutant.declares is not None and looks not in self._looks[item.nodeid]:
                continue
            if not self._passes(item, max(PATIENCE, PATIENCE * self._seconds[item.nodeid])):
                # what found one mutant finds others
                self._items.remove(item)
                self._items.insert(0, item)
                return item.nodeid
        return ''

    @staticmethod
    def _passes(item: pytest.Item, patience_s: float = 0.0) -> bool:
        """Return whether a test passes, within so many seconds unless 0."""
        from _pytest.runner import runtestprotocol

        def late(number: int, frame: FrameType | None) -> None:
            raise TimeoutError(f'{item.nodeid} takes too long')

        # mostly by CPU time: another program that is busy must not make a test fail
        bounds = {
            (signal.SIGPROF, signal.ITIMER_PROF): patience_s,
            (signal.SIGALRM, signal.ITIMER_REAL): LONGEST_WAIT_S if patience_s else 0.0,
        }
        before = {number: signal.signal(number, late) for number, _ in bounds}
        for (_, timer), seconds in bounds.items():
            signal.setitimer(timer, seconds)
        try:
            return all(r.passed for r in runtestprotocol(item, log=False, nextitem=None))
        except TimeoutError:
            return False
        finally:
            for number, timer in bounds:
                signal.setitimer(timer, 0.0)
                signal.signal(number, before[number])


class Findings(NamedTuple):
    """What came of the mutants of a driver; missed are survivors that a second source states."""

    tried: int
    sources: int
    tests: int
    survivors: list[Mutant]
    missed: list[Mutant]


def examine(
    name: str, most: int, part: tuple[int, int], *, only_sources: bool, quick: bool
) -> Findings:
    """Try the mutants of a driver, or as many of them, always the same."""
    sources = Sources(name)
    all_ = list(mutants(drivers.load(name)))
    tried = Random(name).sample(all_, min(most, len(all_)))[part[0] - 1 :: part[1]]
    left: list[Mutant] = []
    for mutant in tried:
        with mutant.change():
            if not sources.notice():
                left.append(mutant)
    if sources.notice():
        raise RuntimeError(f'{name} is not as it was')
    survivors: list[Mutant] = []

    def work() -> None:
        for mutant in left:
            with mutant.change():
                if not tests.notice(mutant):
                    survivors.append(mutant)

    tests = Tests(name, quick=quick)
    if only_sources:
        survivors = left
    elif left:
        with redirect_stdout(StringIO()) as said:
            code = tests.run(work)
        if code:
            raise SystemExit(f'the tests of {name} could not be run:\n{said.getvalue()}')
    missed = [mutant for mutant in survivors if sources.could_notice(mutant)]
    found = len(left) - len(survivors)
    return Findings(len(tried), len(tried) - len(left), found, survivors, missed)


def _part(text: str) -> tuple[int, int]:
    which, _, of = text.partition('/')
    if not 1 <= int(which) <= int(of):
        raise ValueError
    return int(which), int(of)


def main() -> int:
    """Print the table and the survivors; 1 if a second source was not heard."""
    bench = Benchmark(__doc__)
    bench.add_argument('--chip', action='append', choices=drivers.names(), help='only these')
    bench.add_argument('--oracles', action='store_true', help='ask the second sources alone')
    bench.add_argument('--part', type=_part, default=(1, 1), help='which of how many, as 2/5')
    bench.add_size('--most', 10_000, quick=1, help='changes of each chip that are tried')
    options = bench.start()
    bench.head(f'{"chip":10}', 'changes', 'sources', 'tests', 'survive', 'CPU s')
    found: dict[str, Findings] = {}
    for name in options.chip or drivers.names():
        began = time.process_time()
        found[name] = one = examine(
            name, options.most, options.part, only_sources=options.oracles, quick=bench.quick
        )
        seconds = f'{time.process_time() - began:.0f}'
        bench.row(name, one.tried, one.sources, one.tests, len(one.survivors), seconds)
    bench.head(f'{"chip":10}', f'{"kind":8}', f'{"survived":50}', 'a second source states it')
    for name, one in found.items():
        for mutant in one.survivors:
            bench.row(name, mutant.kind, mutant.what, 'yes' if mutant in one.missed else 'no')
    missed = sum(len(one.missed) for one in found.values())
    bench.claim('survived although a second source states it', missed, at_most=0)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
