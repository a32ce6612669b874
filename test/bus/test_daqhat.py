# SPDX-License-Identifier: Apache-2.0
"""The MCC 172 backend: what daqhats is asked, and what its errors become."""

import sys
from types import SimpleNamespace

from imu_bench.bus.daqhat import DaqHat
from imu_bench.bus.opening import kind_of, open_bus
from imu_bench.bus.wiring import Wiring
from imu_bench.errors import BusBusy, ConfigError, NoAnswer
import numpy as np
import pytest


class HatError(Exception):
    """As daqhats has it: address and text."""

    def __init__(self, address, value):
        super().__init__(value)
        self.address, self.value = address, value

    def __str__(self):
        return f'Addr {self.address}: {self.value}'


@pytest.fixture
def daqhats(monkeypatch):
    """Record every call of the library; `error` is raised by the next one."""
    made = SimpleNamespace(calls=[], error=None, opening=None)

    class Board:
        def __init__(self, address):
            if made.opening is not None:
                raise made.opening
            made.calls.append(('open', address))

        def __getattr__(self, name):
            def call(*arguments):
                if made.error is not None:
                    raise made.error
                made.calls.append((name, *arguments))
                return made.answers.get(name)

            return call

    made.answers = {
        'serial': '01ABCDEF',
        'firmware_version': SimpleNamespace(version='1.02'),
        'iepe_config_read': 1,
        'a_in_clock_config_read': SimpleNamespace(
            clock_source=0, sample_rate_per_channel=1024.0, synchronized=True
        ),
        'a_in_scan_read_numpy': SimpleNamespace(
            running=True, hardware_overrun=False, buffer_overrun=True, triggered=True,
            timeout=False, data=np.array([1.0, -2.5]),
        ),
    }  # fmt: skip
    fake = SimpleNamespace(
        mcc172=Board,
        HatError=HatError,
        hat_list=lambda: [SimpleNamespace(address=1, product_name='MCC 118')],
        SourceType=SimpleNamespace(LOCAL=0),
        # values of the library's documentation
        OptionFlags=SimpleNamespace(NOSCALEDATA=1, CONTINUOUS=16),
    )
    monkeypatch.setitem(sys.modules, 'daqhats', fake)
    return made


def test_every_call_of_the_library(daqhats):
    board = DaqHat('daqhat-3')
    assert board.identity() == 'MCC 172, serial number 01ABCDEF, firmware 1.02'
    board.set_supply(1, True)
    assert board.supply(1) is True
    board.set_rate(1024.0)
    assert board.clock() == (1024.0, True)
    board.start(1)
    scan = board.scan()
    assert scan.codes.tolist() == [1.0, -2.5]
    assert (scan.running, scan.hardware_overrun, scan.buffer_overrun) == (True, False, True)
    board.stop()
    board.close()
    assert daqhats.calls == [
        ('open', 3),
        ('firmware_version',),
        ('serial',),
        ('iepe_config_write', 1, 1),
        ('iepe_config_read', 1),
        ('a_in_clock_config_write', 0, 1024.0),
        ('a_in_clock_config_read',),
        # second channel alone, ten seconds of buffer, continuous codes
        ('a_in_scan_start', 2, 10240, 17),
        ('a_in_scan_read_numpy', -1, 0.0),
        ('a_in_scan_stop',),
        ('a_in_scan_cleanup',),
    ]


def test_a_block_is_waited_for_and_taken_whole(daqhats):
    board = DaqHat('daqhat-0')

    def answers(*blocks):
        found = [
            SimpleNamespace(
                running=True, hardware_overrun=False, buffer_overrun=False, data=np.array(block)
            )
            for block in blocks
        ]

        def read(number, timeout_s):
            daqhats.calls.append((number, timeout_s))
            return found.pop(0)

        board._board.a_in_scan_read_numpy = read
        daqhats.calls.clear()

    answers([], [1.0], [2.0, 3.0])
    assert board.scan(0.025).codes.tolist() == [1.0, 2.0, 3.0]
    assert daqhats.calls == [(-1, 0.0), (1, 0.025), (-1, 0.0)]
    answers([], [], [])
    assert board.scan(0.025).codes.tolist() == []
    answers([4.0])
    assert board.scan(0.025).codes.tolist() == [4.0]


@pytest.mark.parametrize(
    ('text', 'kind', 'says'),
    [
        ('Incorrect response.', NoAnswer, 'plugged in'),
        ('Scan not active.', NoAnswer, 'plugged in'),
        ('A scan is already active.', BusBusy, 'another program'),
        ('Cannot change the clock configuration while a scan is active.', BusBusy, 'another'),
    ],
)
def test_errors_are_named(daqhats, text, kind, says):
    board = DaqHat('daqhat-0')
    daqhats.error = HatError(0, text)
    with pytest.raises(kind, match=f'daqhat-0: Addr 0: {text}.*{says}') as caught:
        board.start(0)
    assert caught.value.__cause__ is daqhats.error


def test_no_such_board_lists_those_there_are(daqhats):
    daqhats.opening = HatError(0, 'Board not responding.')
    with pytest.raises(NoAnswer, match=r'daqhat-0: no MCC 172.*not responding.*daqhat-1: MCC 118'):
        DaqHat('daqhat-0')


def test_a_missing_c_library_is_said(daqhats):
    daqhats.opening = Exception('daqhats shared library is not installed.')
    with pytest.raises(ConfigError, match=r'not installed.*install\.sh'):
        DaqHat('daqhat-0')


def test_a_missing_package_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, 'daqhats', None)
    with pytest.raises(ConfigError, match='"pip install daqhats"'):
        DaqHat('daqhat-0')


@pytest.mark.parametrize('device', ['daqhat-8', 'daqhat-', 'daqhat-01'])
def test_there_are_eight_addresses(daqhats, device):
    with pytest.raises(ConfigError, match='daqhat-0 to daqhat-7'):
        DaqHat(device)


def test_it_is_opened_by_its_name(daqhats):
    assert kind_of('daqhat-2') == 'daqhat'
    buses = open_bus('daqhat-2', {'': Wiring()}, ('daqhat', 'i2c'))
    assert {part: bus.name for part, bus in buses.items()} == {'': 'daqhat-2'}
    with pytest.raises(ConfigError, match='is daqhat; this sensor can do i2c'):
        open_bus('daqhat-2', {'': Wiring()}, ('i2c',))


def test_the_buffer_is_let_go_even_if_the_board_does_not_stop(daqhats):
    board = DaqHat('daqhat-0')
    stop = HatError(0, 'Incorrect response.')

    class Failing:
        cleaned = False

        def a_in_scan_stop(self):
            raise stop

        def a_in_scan_cleanup(self):
            self.cleaned = True

    board._board = Failing()
    with pytest.raises(NoAnswer):
        board.stop()
    assert board._board.cleaned
