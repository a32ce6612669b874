# SPDX-License-Identifier: Apache-2.0
"""When a sensor is well, when it is not, and how that is said."""

from dataclasses import replace

from imu_bench.acquisition import AcquisitionStats
from imu_bench.live.status import acquisition_values, judge, Losses, number
from imu_bench.metrology.estimate import Estimate
import pytest

WELL = AcquisitionStats(
    state='running',
    error='',
    part='MPU-9250',
    nominal_hz=1000.0,
    rate=Estimate(1004.0, 1003.9, 1004.1, 'Hz'),
    rate_error=Estimate(4000.0, 3900.0, 4100.0, 'ppm'),
    delivered=Estimate(1003.8, 1003.6, 1004.0, 'Hz'),
    jitter=Estimate(1e-6, 0.9e-6, 1.1e-6, 's'),
    stamp_uncertainty=Estimate(3e-5, 0.0, 3e-5, 's'),
    samples=12345,
    lost=7,
    dropped=2,
    bus_errors=3,
    failures=4,
    recoveries=1,
    late=5,
    queued=6,
    counters={'fifo_overflows': 8},
)
BEFORE = Losses.of(WELL)


def test_old_losses_are_no_fault_of_now():
    assert judge(WELL, BEFORE) == ('ok', 'running')


@pytest.mark.parametrize(
    ('change', 'level', 'says'),
    [
        ({'error': 'i2c-1 0x68: no answer', 'state': 'recovering'}, 'error', 'no answer'),
        ({'state': 'starting'}, 'warn', 'starting'),
        ({'lost': 9}, 'warn', '2 lost'),
        ({'bus_errors': 4, 'recoveries': 2}, 'warn', '1 bus errors, 1 recoveries'),
        ({'delivered': Estimate(900.0, 899.0, 901.0, 'Hz')}, 'warn', 'delivers 900 Hz of 1004 Hz'),
    ],
)
def test_what_is_wrong_is_said(change, level, says):
    found, message = judge(replace(WELL, **change), BEFORE)
    assert found == level
    assert says in message


@pytest.mark.parametrize(
    ('change', 'level', 'says'),
    [
        ({'state': 'stopped', 'over': 'over after 3 s'}, 'ok', 'over after 3 s'),
        # in the middle of a fault
        ({'over': 'over after 3 s', 'error': 'no answer'}, 'ok', 'over after 3 s'),
        ({'over': 'event 3 differs', 'error': 'event 3 differs'}, 'error', 'event 3 differs'),
        ({'tape_problem': 'a.wire: ends early'}, 'warn', 'a.wire: ends early'),
    ],
)
def test_what_is_played_and_recorded_is_said(change, level, says):
    assert judge(replace(WELL, **change), BEFORE) == (level, says)


def test_a_rate_not_known_yet_is_no_fault():
    unknown = Estimate.not_observable('Hz', 'no data yet')
    assert judge(replace(WELL, rate=unknown, delivered=unknown), BEFORE)[0] == 'ok'


def test_every_count_is_there():
    values = acquisition_values(WELL)
    assert values['rate_hz'] == '1004'
    assert values['rate_hz.low'] == '1003.9'
    assert values['rate_error_ppm'] == '4000'
    assert values['counter.fifo_overflows'] == 8
    for name in ('samples', 'lost', 'dropped', 'bus_errors', 'failures', 'recoveries', 'late'):
        assert values[name] == getattr(WELL, name)


def test_a_number_that_is_not_observable_says_why():
    entries = number('jitter_s', Estimate.not_observable('s', 'no data yet'))
    assert entries == {'jitter_s': 'not observable: no data yet'}
