# SPDX-License-Identifier: Apache-2.0
"""Which time stamps and which samples of a recording to believe."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from imu_bench.bags.problems import NOT_A_NUMBER, Problem
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.gathering import PIECE
from msg_conversions.quantities import AXES, IMU_QUANTITIES
import numpy as np
import numpy.typing as npt

MAX_BACKWARD = 0.01
"""Share of steps back in time above which header stamps are not a time axis."""

MAX_REPEATED = 0.5
"""Share of repeated stamps above which several samples wear one stamp."""

MAX_SPAN_NS = 1 << 62
"""Stamps further apart, 146 years, are damaged; their differences may not fit 64 bits."""


OUTER = 'outer header'
"""Where the stamps of an Imu within another message come from, if that one's are better."""

EVENER = 2.0
"""Times less scatter of its steps from which the outer header is the time of measurement."""


def choose(
    stamps: npt.NDArray[np.int64],
    receive_ns: npt.NDArray[np.int64] | None,
    origin: str,
    outer_ns: npt.NDArray[np.int64] | None = None,
) -> tuple[npt.NDArray[np.int64], str, str]:
    """
    Return the stamps to use, where they come from, and why.

    The header stamp is the time of measurement and is used unless it cannot be
    one; then the time of arrival takes its place, jitter of the transport included.
    Of the two headers of an Imu within another message the one with the more even
    steps is used.
    """
    fault = _fault(stamps, origin)
    if outer_ns is not None and not _fault(outer_ns, OUTER):
        own, outer = (_scatter(times) for times in (stamps, outer_ns))
        if fault or own > EVENER * outer:
            steps = f'its steps scatter by {outer * 1e3:.3g} ms, those of the own header by'
            return outer_ns, OUTER, fault or f'{steps} {own * 1e3:.3g} ms'
    if fault and receive_ns is not None and not _fault(receive_ns, 'receive'):
        return receive_ns, 'receive', fault
    return stamps, origin, fault or 'they increase as a time of measurement does'


def check_span(stamps: npt.NDArray[np.int64], where: str) -> None:
    """Make sure that differences of stamps fit 64 bits."""
    if stamps.size and _span(stamps) > MAX_SPAN_NS:
        raise RecordingError(
            f'{where}: the stamps go from {stamps.min()} to {stamps.max()} ns: some are damaged, '
            'or the unit of the time column is another'
        )


def _span(stamps: npt.NDArray[np.int64]) -> int:
    return int(stamps.max()) - int(stamps.min())


def _scatter(stamps: npt.NDArray[np.int64]) -> float:
    """Return the mean distance of the steps from their median in s, gaps left out."""
    steps = np.diff(stamps[: 1 << 16]) * 1e-9
    if not steps.size:
        return 0.0
    steps = steps[steps <= 3.0 * max(float(steps.mean()), float(np.median(steps)))]
    return float(np.abs(steps - np.median(steps)).mean())


def _fault(stamps: npt.NDArray[np.int64], origin: str) -> str:
    """Return why stamps are no time axis, or nothing."""
    if stamps.size < 2:
        return f'the {origin} stamp is zero' if stamps.size and stamps[0] == 0 else ''
    if _span(stamps) > MAX_SPAN_NS:
        return f'the {origin} stamps span centuries'
    backward = repeated = 0
    for start in range(0, stamps.size - 1, PIECE):
        steps = np.diff(stamps[start : start + PIECE + 1])
        backward += int(np.count_nonzero(steps < 0))
        repeated += int(np.count_nonzero(steps == 0))
    steps_taken = stamps.size - 1
    if repeated == steps_taken:
        return f'every {origin} stamp is {"zero" if stamps[0] == 0 else "the same"}'
    if backward > MAX_BACKWARD * steps_taken:
        return f'{backward / steps_taken:.0%} of the {origin} stamps step back in time'
    if repeated > MAX_REPEATED * steps_taken:
        return f'{repeated / steps_taken:.0%} of the {origin} stamps repeat the one before'
    return ''


Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

LARGEST, SMALLEST = 1e30, 1e-100
"""In SI: beyond them no sensor measures, and powers of the numbers do not fit a float."""

_CACHED = 1 << 15
"""Values that fit into the fast memory of a processor, with their sizes."""

_INERTIAL = {quantity.field: quantity.name for quantity in IMU_QUANTITIES}


def sift(
    columns: Mapping[str, Floats | None], where: str
) -> tuple[tuple[str, ...], Bools | None, list[str]]:
    """
    Return which quantities are there, which samples to keep, and notes on what is not kept.

    A sample with a NaN or infinite acceleration or angular velocity is not kept; what exceeds
    `LARGEST` counts as infinite.  An axis that never has a number is absent, becomes NaN, and
    judges no sample.  Temperature and magnetic field judge no sample either: they are not kept
    at all unless complete.  What is below `SMALLEST` becomes zero.
    """
    there: list[str] = []
    notes: list[str] = []
    good: Bools | None = None
    for field, values in columns.items():
        if values is None:
            continue
        if field not in _INERTIAL:
            if _complete(field, values, notes):
                there.append(field)
            continue
        for axis, column in zip(AXES, values.T, strict=True):
            finite, note = _axis(f'{_INERTIAL[field]}.{axis}', column)
            notes += [note] if note else []
            if finite:
                there.append(field)
            if 0 < finite < column.size:
                good = _narrowed(good, column)
    if not _INERTIAL.keys() & set(there):
        raise RecordingError(f'{where}: not a single finite value is stored')
    if good is not None and not good.any():
        raise RecordingError(f'{where}: every sample has a NaN or infinite value; {notes[0]}')
    return tuple(dict.fromkeys(there)), good, notes


def _axis(name: str, column: Floats) -> tuple[int, str]:
    """Return how many values of an axis are finite, and a note if that is not all of them."""
    finite, nan = _counts(column)
    infinite = column.size - finite - nan
    if not finite and infinite:
        column[:] = np.nan
        return 0, f'{name} is not used: it holds no finite value'
    if 0 < finite < column.size:
        words = f'{name}: {nan} NaN and {infinite} infinite values left out'
        return finite, Problem(words, NOT_A_NUMBER)
    return finite, ''


def _narrowed(good: Bools | None, column: Floats) -> Bools:
    """Return which samples are still good when those that are not finite here are not."""
    narrowed = np.ones(column.size, np.bool_) if good is None else good
    for part in _pieces(column.size):
        narrowed[part] &= _finite(column[part])
    return narrowed


def _complete(field: str, values: Floats, notes: list[str]) -> bool:
    """Return whether the axes that are there at all have a number in every sample."""
    rows = values.reshape(len(values), -1)
    present = [row for row in rows.T if _counts(row)[0]]
    whole = 0
    for part in _pieces(len(rows) if present else 0):
        whole += int(np.logical_and.reduce([_finite(row[part]) for row in present]).sum())
    if present and whole == len(rows):
        return True
    notes.append(f'{field} is not used: it has numbers in {whole} of {len(rows)} samples only')
    return False


def _counts(column: Floats) -> tuple[int, int]:
    """Return how many values are finite, and how many are NaN; make tiny ones zero."""
    finite = nan = 0
    sizes = np.empty(min(column.size, _CACHED))
    for start in range(0, column.size, _CACHED):
        values = column[start : start + _CACHED]
        size = np.abs(values, out=sizes[: values.size])
        if size.max() <= LARGEST:  # False if there is a NaN
            finite += values.size
        else:
            finite += int(np.count_nonzero(size <= LARGEST))
            nan += int(np.count_nonzero(np.isnan(values)))
        if not size.min() >= SMALLEST:
            values[size < SMALLEST] = 0.0
    return finite, nan


def _finite(values: Floats) -> Bools:
    return np.asarray(np.abs(values) <= LARGEST, np.bool_)


def _pieces(size: int) -> Iterator[slice]:
    return (slice(start, min(start + PIECE, size)) for start in range(0, size, PIECE))
