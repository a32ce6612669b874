# SPDX-License-Identifier: Apache-2.0
"""The GPIO backend: what python-periphery is asked, whose time edges have, what is said."""

import errno
import sys
import time
from types import SimpleNamespace

from imu_bench.bus.clock import SystemClock
from imu_bench.bus.gpio import GpioLine, GpioOutput
from imu_bench.bus.opening import open_bus
from imu_bench.config.lines import parse_line
from imu_bench.errors import BusBusy, BusError, ConfigError, PermissionDenied
import pytest


@pytest.fixture
def library(monkeypatch):
    """Put a library with one line in the place of python-periphery."""
    made = SimpleNamespace(calls=[], events=[], error=None)

    class GPIOError(IOError):
        pass

    class GPIO:
        def __init__(self, *arguments, **options):
            made.calls.append((*arguments, options))
            if made.error is not None:
                raise made.error

        def poll(self, timeout):
            assert timeout == 0
            return bool(made.events)

        def read_event(self):
            if made.error is not None:
                raise made.error
            return SimpleNamespace(edge='rising', timestamp=made.events.pop(0))

        def write(self, value):
            made.calls.append(('write', value))

        def close(self):
            made.calls.append(('close',))

    made.GPIOError = GPIOError
    monkeypatch.setitem(sys.modules, 'periphery', SimpleNamespace(GPIO=GPIO, GPIOError=GPIOError))
    return made


def test_edges_are_in_the_time_of_the_bench(library):
    clock = SystemClock()
    line = GpioLine('gpiochip0:17', clock)
    assert library.calls == [
        ('/dev/gpiochip0', 17, 'in', {'label': 'imu_bench', 'edge': 'rising'})
    ]
    before = clock.now_ns()
    library.events = [time.monotonic_ns(), time.monotonic_ns()]
    after = clock.now_ns()
    first, second = line.edges()
    # the monotonic clock, told in that of the bench, to what reading it takes
    assert before - 50_000 <= first <= second <= after + 50_000
    assert line.edges() == []
    line.close()
    assert library.calls[-1] == ('close',)


def test_an_output_begins_high(library):
    line = GpioOutput('gpiochip4:GPIO27')
    assert library.calls == [('/dev/gpiochip4', 'GPIO27', 'high', {'label': 'imu_bench'})]
    line.drive(False)
    assert library.calls[-1] == ('write', False)


@pytest.mark.parametrize(
    ('code', 'kind', 'says'),
    [
        (errno.EACCES, PermissionDenied, 'usermod -aG gpio'),
        (errno.EBUSY, BusBusy, 'somebody else'),
        (errno.ENOENT, BusError, 'gpiodetect'),
    ],
)
def test_errors_are_named(library, code, kind, says):
    library.error = library.GPIOError(code, 'as the kernel says')
    with pytest.raises(kind, match=f'gpiochip0:17: .*{says}'):
        GpioLine('gpiochip0:17', SystemClock())


def test_a_line_that_is_not_there_is_said(library):
    library.error = LookupError('no such line')
    with pytest.raises(BusError, match=r'gpiochip0:99: there is no such line'):
        GpioLine('gpiochip0:99', SystemClock())


def test_a_line_that_fails_later_is_said(library):
    line = GpioLine('gpiochip0:17', SystemClock())
    library.events, library.error = [1], library.GPIOError(errno.ENODEV, 'gone')
    with pytest.raises(BusError, match=r'gpiochip0:17: .*gone'):
        line.edges()


@pytest.mark.parametrize('text', ['17', 'gpiochip0', 'gpiochip0:', 'i2c-1:3', 'gpiochip0:a b'])
def test_what_names_no_line_is_refused(text):
    with pytest.raises(ConfigError, match='names no line; write chip and line like gpiochip0:17'):
        parse_line(text)


def test_a_bus_whose_line_cannot_be_had_is_released(library, monkeypatch):
    closed = []
    monkeypatch.setattr(
        'imu_bench.bus.opening._open_one',
        lambda *arguments: SimpleNamespace(close=lambda: closed.append(True)),
    )
    library.error = library.GPIOError(errno.EBUSY, 'busy')
    wiring = {'': SimpleNamespace(i2c_addresses=(), spi_max_hz=1, serial_baud=0)}
    with pytest.raises(BusBusy):
        open_bus('spidev0.0', wiring, ('spi',), data_ready='gpiochip0:17')
    assert closed == [True]
