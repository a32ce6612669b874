# SPDX-License-Identifier: Apache-2.0
"""A recording to which something happens, and how what it says is held against its bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import itertools
from pathlib import Path
import subprocess
import sys
from typing import Any

from benchmarks import _witness
from benchmarks._recorded import generic_bench, Recording

SIX = 'machine_vibration'
RATES = (400.0, 1000.0, 952.0, 100.0, 1344.0, 1000.0)
"""Hz, of the six sensors of Shabulinzenze 2020."""

KEEPS = 0.01
"""Share of its samples that a sensor may miss and still keep its rate."""

CLOSE = 0.8
"""Share of `KEEPS` from which on, and its inverse up to which, either verdict is right."""

MUCH = 0.06
"""Share of the samples of a bench that is missing only where a machine is too small for it."""

EXACT, SHARE = 2, 0.01
"""
How far from the stamps the count of a sensor may be: so many, or this share of what is missing.

Either end of a recording is right to half a sample, and so is a sensor's account of a pause.
"""

REGULAR = 0.9
"""Share of stamps that are a period apart from which on they tell a single sample."""


@dataclass
class Outcome:
    """
    What came of a recording.

    Attributes
    ----------
    samples : int
        In the bag, of the main topics.
    missing, on_the_way : int
        As the witness finds it: samples missing by their stamps; messages published, not there.
    unsaid : int
        How far what the recording says is from that, over all sensors.
    problems : list of str
        What else should not be.
    remarks : list of str
    """

    samples: int = 0
    missing: int = 0
    on_the_way: int = 0
    unsaid: int = 0
    code: int | None = None
    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def __iadd__(self, other: Outcome) -> Outcome:
        self.samples += other.samples
        self.missing += other.missing
        self.on_the_way += other.on_the_way
        self.unsaid += other.unsaid
        self.code = other.code
        self.problems += other.problems
        self.remarks += other.remarks
        return self


@dataclass
class Stage:
    """Where a row is played, and how long."""

    folder: Path
    seconds: float
    quick: bool
    kills: int
    suspended_s: float
    seed: int
    number: Iterator[int] = field(default_factory=itertools.count)

    def place(self) -> Path:
        """Return a folder of its own for a recording."""
        place = self.folder / str(next(self.number))
        place.mkdir()
        return place

    def sources(self, place: Path) -> str:
        """Return a bench of simulated sources with the rates of the six sensors."""
        return str(generic_bench(place, RATES[: 2 if self.quick else None]))


def judge(
    recording: Recording, *, faulty: bool | None = None, bag: Path | None = None,
    cut: bool = False,
) -> Outcome:  # fmt: skip
    """
    Hold what a recording says against what its bag has.

    Parameters
    ----------
    recording : Recording
        It is over.
    faulty : bool, optional
        Whether it must end with 1; by default that depends on what is missing.
    bag : Path, optional
        Where the bag can be read, if not where it was written.
    cut : bool
        Whether the bag ends early: then more is lost than can be seen in it.
    """
    outcome = Outcome(code=recording.code, problems=recording.problems())
    bag = bag or recording.bag
    if not (bag / 'metadata.yaml').exists():
        whole = bag.with_name('whole')
        outcome.problems += [
            'the bag is not finished',
            *imu_bench(['import', str(bag), '-o', str(whole)]),
        ]
        bag = whole
    found = _witness.sensors(bag) if bag.exists() else {}
    said = recording.lost()
    text = recording.said()
    if not found:
        outcome.problems.append('the bag has no sample')
    wrong, close = False, False
    for name, own in found.items():
        lost = said.get(name, {})
        before, after = lost.get('sensor', 0) + lost.get('queue', 0), own.before_the_way
        on_the_way = lost.get('way', 0) + lost.get('disk', 0) + lost.get('before', 0)
        off = [after - before, own.on_the_way - on_the_way]
        off = [max(0, each) if cut else abs(each) for each in off]
        outcome.samples += own.messages
        outcome.missing += own.missing
        outcome.on_the_way += own.on_the_way
        # where the computer dated the samples, stamps are no better than a share of all of them
        known = after if own.regular > REGULAR else own.messages + own.missing
        if off[0] > max(EXACT, SHARE * known):
            outcome.unsaid += off[0]
            outcome.remarks.append(f'{name}: says {before} lost when read, by stamps {after}')
        if off[1]:
            outcome.unsaid += off[1]
            outcome.remarks.append(
                f'{name}: says {on_the_way} lost on the way, found {own.on_the_way}'
            )
        made = own.messages + own.missing
        share = own.missing / (KEEPS * made)
        wrong = wrong or own.on_the_way > 0 or share > 1.0
        # the time that counts is not quite that between its first and last sample
        close = close or CLOSE < share < 1.0 / CLOSE
        wrong = wrong or (cut and on_the_way > 0)
        if own.missing > EXACT and f'{name}: ' in text and not lost and recording.code == 0:
            outcome.problems.append(f'{name}: {own.missing} missing, and it says nothing of it')
    outcome.remarks += recording.errors()
    expected = wrong if faulty is None else faulty
    if (recording.code == 1) != expected and not (close and faulty is None):
        outcome.problems.append(f'exit code {recording.code}, expected {int(expected)}')
    return outcome


def recorded(
    stage: Stage, bench: str, act: Callable[[Recording], None] = lambda recording: None,
    *, more_s: float = 0.0, faulty: bool | None = None, cut: bool = False,
    seconds: float | None = None, says: str = '', **options: Any,
) -> Outcome:  # fmt: skip
    """Record a bench, do something to it meanwhile, and judge."""
    place = stage.place()
    name = stage.sources(place) if bench == 'sources' else bench
    with Recording(place, name, seconds or stage.seconds, **options) as recording:
        recording.wait_begun()
        act(recording)
        late_s = recording.wait_ended(more_s)
        outcome = judge(recording, faulty=faulty, cut=cut)
    outcome.remarks.append(f'ended {late_s:.0f} s after its time')
    if (
        outcome.missing > MUCH * (outcome.samples + outcome.missing)
        and says not in recording.said()
    ):
        outcome.problems.append(f'it does not say: {says}')
    return outcome


def imu_bench(arguments: list[str]) -> list[str]:
    """Run `imu-bench`; return what went wrong."""
    command = [sys.executable, '-m', 'imu_bench.cli.main', *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    words = done.stderr.strip().splitlines()[-1:] or ['']
    return [f'{arguments[0]} ends with {done.returncode}: {words[0]}'] if done.returncode else []
