# SPDX-License-Identifier: Apache-2.0
"""
A sensor that the kernel reads: towards the acquisition it behaves as a driver does.

Stamps are the kernel's: those of the interrupt, or of the moment at which its driver found the
sample.  Samples that the kernel could not keep are seen by the gap they leave.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
import os
import time
from typing import Any

from imu_bench.bus.failures import translate
from imu_bench.bus.iio.records import Layout
from imu_bench.bus.iio.tree import ENABLE, IioDevice
from imu_bench.bus.interface import Clock
from imu_bench.config.schema import Setting
from imu_bench.errors import BusError, NotReady
from imu_bench.samples import Samples
from imu_bench.units import GAUSS
import numpy as np
import numpy.typing as npt

SETTINGS = (
    Setting('rate_hz', 0.0, 'Output data rate; 0 for that which is set.', bounds=(0.0, 50e3),
            unit='Hz'),
    Setting('trigger', '', 'Trigger of the buffer; empty for that which is set.'),
    Setting('buffer_s', 1.0, 'The kernel keeps so much.', bounds=(0.1, 60.0), unit='s'),
)  # fmt: skip
"""What the file of such a sensor may set beside the settings of every sensor."""

QUANTITIES = {
    # Documentation/ABI/testing/sysfs-bus-iio: after offset and scale m/s², rad/s, G and m°C
    'accel': ('acceleration', 1.0),
    'anglvel': ('angular_velocity', 1.0),
    'magn': ('magnetic_field', GAUSS),
    'temp': ('temperature', 1e-3),
}
AXES = ('x', 'y', 'z')
TIMESTAMP = 'timestamp'
POLL_S = 0.02
READ_SCANS = 4096
CLOCKS: Mapping[str, Callable[[], int]] = {
    'monotonic': time.monotonic_ns,
    'realtime': time.time_ns,
    'monotonic_raw': lambda: time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW),
    'boottime': lambda: time.clock_gettime_ns(time.CLOCK_BOOTTIME),
    'tai': lambda: time.clock_gettime_ns(time.CLOCK_TAI),
}
"""Clocks of ``current_timestamp_clock``; the coarse ones are told by their fine ones."""


class IioSensor:
    """
    A device of Industrial I/O with its buffer.

    Parameters
    ----------
    settings : mapping
        Checked values of `SETTINGS`.
    """

    paced = False
    rates_hz: Mapping[str, float] = {}

    def __init__(self, device: IioDevice, clock: Clock, settings: Mapping[str, Any]) -> None:
        self.name = device.name
        self.title = device.called
        self.counters: Counter[str] = Counter(bus_errors=0, gaps=0, restarts=0)
        self.continuity = 0
        self.dated = True
        self.skipped: dict[int, int] = {}
        self.edge: tuple[int, int] | None = None
        self.latch_ns: int | None = None
        self._device = device
        self._clock = clock
        self._settings = settings
        self._file = -1
        self._rest = b''
        self._last_ns: int | None = None
        self._shift_ns = 0
        self._rate_hz = float(settings['rate_hz']) or self._set_rate()
        self._layout = Layout({})
        self._columns: dict[str, list[tuple[str, float, float]]] = {}
        self._turns: dict[str, npt.NDArray[np.float64]] = {}
        self._stamped = False

    @property
    def rate_hz(self) -> float:
        """Return the output data rate that is set."""
        return self._rate_hz

    @property
    def poll_period_s(self) -> float:
        """Return some samples at a time, and a slow sensor not needlessly often."""
        return min(max(POLL_S, 0.5 / self.rate_hz), float(self._settings['buffer_s']) / 4)

    def identify(self) -> str:
        """Return what the kernel calls it."""
        with self._counted():
            return self._device.get('name') + ' (Linux IIO)'

    def configure(self) -> None:
        """Set rate, trigger and channels up; find out how records are laid out."""
        device = self._device
        with self._counted():
            device.set(f'{device.buffer}/enable', 0)
            wanted = float(self._settings['rate_hz'])
            if wanted:
                device.set(self._rate_file(), f'{wanted:g}')
            self._rate_hz = self._set_rate()
            if wanted and abs(self._rate_hz / wanted - 1) > 0.01:
                raise BusError(
                    f'{self.name}: rate_hz {wanted:g} was set, but it holds {self._rate_hz:g} Hz; '
                    f'allowed: {device.first("sampling_frequency_available") or "not said"}'
                )
            if self._settings['trigger']:
                device.set('trigger/current_trigger', self._settings['trigger'])
            if device.has('current_timestamp_clock'):
                device.set('current_timestamp_clock', 'monotonic')
            self._choose()
            length = max(round(float(self._settings['buffer_s']) * self._rate_hz), 2)
            device.set(f'{device.buffer}/length', length)

    def start(self) -> None:
        """Let samples flow into the buffer."""
        device = self._device
        with self._counted():
            self._close()
            self._shift_ns = self._shift()
            self._rest, self._last_ns = b'', None
            try:
                device.set(f'{device.buffer}/enable', 1)
            except BusError as error:
                if device.has('trigger/current_trigger') and not device.get(
                    'trigger/current_trigger'
                ):
                    there = ', '.join(device.triggers()) or 'none'
                    raise NotReady(
                        f'{self.name}: it needs a trigger; set trigger to one of: {there}'
                    ) from error
                raise
            try:
                self._file = os.open(device.node, os.O_RDONLY | os.O_NONBLOCK)
            except OSError as error:
                raise self._failed(error) from error
        self.continuity += 1

    def stop(self) -> None:
        """Let no more samples flow."""
        self._close()
        with self._counted():
            self._device.set(f'{self._device.buffer}/enable', 0)

    def close(self) -> None:
        """Release the device."""
        if self._file >= 0:
            with suppress(BusError):  # it may be gone
                self.stop()

    def read(self) -> list[Samples]:
        """Return everything new; what the kernel could not keep is skipped."""
        self.skipped = {}
        before = self._clock.now_ns()
        with self._counted():
            data = self._rest + self._available()
        whole = len(data) // self._layout.size * self._layout.size
        self._rest = data[whole:]
        if not whole:
            return []
        values = self._layout.decode(data[:whole])
        n = whole // self._layout.size
        if self._stamped:
            stamps = values[TIMESTAMP][:, 0].astype(np.int64) + self._shift_ns
        else:
            after = self._clock.now_ns()
            ages = np.arange(n - 1, -1, -1) * (1e9 / self._rate_hz)
            stamps = (before + after) // 2 - np.rint(ages).astype(np.int64)
        return self._runs(Samples(stamps, **self._si(values)))

    # --- setting up ----------------------------------------------------------------------
    def _rate_file(self) -> str:
        kinds = [f'in_{kind}_sampling_frequency' for kind in QUANTITIES]
        for file in ('sampling_frequency', *kinds):
            if self._device.has(file):
                return file
        raise NotReady(
            f'{self.name}: {self.title} says nothing of its rate; it is that of its trigger: set '
            'rate_hz to it'
        )

    def _set_rate(self) -> float:
        try:
            return float(self._device.get(self._rate_file()))
        except NotReady:
            if self._settings['rate_hz']:
                return float(self._settings['rate_hz'])
            raise

    def _choose(self) -> None:
        """Enable what the bench knows, and the time; switch the rest off."""
        device, found = self._device, self._device.channels()
        wanted = {
            kind: [f'{kind}_{axis}' for axis in AXES] if f'{kind}_x' in found else [kind]
            for kind in QUANTITIES
            if f'{kind}_x' in found or kind in found
        }
        if not wanted:
            raise NotReady(f'{self.name}: {self.title} has none of {", ".join(QUANTITIES)}')
        chosen = {name for names in wanted.values() for name in names} | {TIMESTAMP}
        for name in found:
            device.set(f'{device.scan}/in_{name}_en', int(name in chosen))
        # a driver may have some channels only together
        on = {name: e for name, e in found.items() if self._is_on(name)}
        self._layout = Layout(on)
        self._stamped = TIMESTAMP in on
        self._columns = {
            kind: [(name, *device.line(name)) for name in names if name in on]
            for kind, names in wanted.items()
        }
        self._columns = {kind: columns for kind, columns in self._columns.items() if columns}
        self._turns = {
            kind: device.mount_matrix(kind)
            for kind, columns in self._columns.items()
            if len(columns) == len(AXES)
        }

    def _is_on(self, name: str) -> bool:
        return self._device.get(f'{self._device.scan}/in_{name}_en') == '1'

    def _shift(self) -> int:
        """Return what leads from the clock of the stamps to that of the bench."""
        named = self._device.first('current_timestamp_clock') or 'realtime'
        clock = CLOCKS.get(named.removesuffix('_coarse'), time.time_ns)
        readings = []
        for _ in range(9):
            before = clock()
            shown = self._clock.now_ns()
            after = clock()
            readings.append((after - before, shown - (before + after) // 2))
        return min(readings)[1]

    # --- the stream ----------------------------------------------------------------------
    def _available(self) -> bytes:
        parts = []
        with suppress(BlockingIOError):
            while True:
                part = os.read(self._file, READ_SCANS * self._layout.size)
                parts.append(part)
                if len(part) < READ_SCANS * self._layout.size:
                    break
        return b''.join(parts)

    def _si(self, values: Mapping[str, npt.NDArray[np.generic]]) -> dict[str, Any]:
        columns: dict[str, Any] = {}
        for kind, channels in self._columns.items():
            quantity, unit = QUANTITIES[kind]
            si = np.column_stack(
                [
                    (values[name][:, 0].astype(np.float64) + offset) * (scale * unit)
                    for name, scale, offset in channels
                ]
            )
            columns[quantity] = si @ self._turns[kind].T if kind in self._turns else si[:, 0]
        return columns

    def _runs(self, samples: Samples) -> list[Samples]:
        """Return the runs between gaps; each gap is so many samples that the kernel lost."""
        stamps = samples.stamps
        self.edge = None
        if not self._stamped:
            return [samples]
        last = stamps[0] if self._last_ns is None else self._last_ns
        periods = np.diff(stamps, prepend=last) * 1e-9 * self._rate_hz
        gaps = np.flatnonzero(periods > 1.5)
        self._last_ns = int(stamps[-1])
        runs: list[Samples] = []
        for first, end in zip([0, *gaps[gaps > 0]], [*gaps[gaps > 0], len(stamps)], strict=True):
            if first in gaps:
                self.counters['gaps'] += 1
                self.skipped[len(runs)] = round(float(periods[first])) - 1
            runs.append(samples[first:end])
        if len(runs) == 1:
            self.edge = 0, int(stamps[-1])
        return runs

    def _close(self) -> None:
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _failed(self, error: OSError) -> BusError:
        return translate(error, str(self._device.node), group='iio', enable=ENABLE)

    @contextmanager
    def _counted(self) -> Iterator[None]:
        """Count errors of the device, and name those of the operating system."""
        try:
            yield
        except BusError:
            self.counters['bus_errors'] += 1
            raise
        except OSError as error:
            self.counters['bus_errors'] += 1
            raise self._failed(error) from error
