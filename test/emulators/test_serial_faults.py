# SPDX-License-Identifier: Apache-2.0
"""
MTi-300 and BNO055 on serial lines: stamps by the device's count, faults named and survived.

The acceleration grows evenly with time, so that every sample says when it was measured: one that
was invented, doubled or stamped wrongly is found by its value.
"""

from imu_bench.errors import (
    BusBusy,
    ChecksumError,
    FrameError,
    IdentityError,
    NoAnswer,
    PermissionDenied,
)
from imu_bench.samples import Samples
import numpy as np
import pytest

SLOPE = 2.0  # m/s² per second
SPAN_S = 36.0  # from -36 to 36 m/s²
CASES = [('mti300', 'serial'), ('bno055', 'serial'), ('bno055', 'i2c')]
STRETCHED = {('bno055', 'i2c'): 0.05}
"""
Share of its samples that a chip may lose because it stretches the clock: a reading of the BNO055
then takes almost as long as it takes to make the next sample.
"""
every_line = pytest.mark.parametrize(('name', 'kind'), CASES)


def ramp(stamps, origin_ns):
    return ((np.asarray(stamps) - origin_ns) * 1e-9 % SPAN_S - SPAN_S / 2) * SLOPE


def growing(source):
    """Let the acceleration of a source along x grow evenly."""
    source.origin_ns = source.anchor_ns

    class Growing(type(source)):
        def samples_ahead(self, t_ns):
            # what costs by the call is paid for many samples at once, as with a simulated sensor
            return self.samples_until(t_ns + round(64 * self.period_ns))

        def samples_until(self, t_ns):
            made = super().samples_until(t_ns)
            force = made.acceleration.copy()
            force[:, 0] = ramp(made.stamps, self.origin_ns)
            return Samples(
                made.stamps, force, made.angular_velocity, made.magnetic_field, made.temperature
            )

    source.__class__ = Growing
    return source


def assert_only_true_samples(made, latency_s, late_s):
    """Check that each sample was made, once, and when its stamp says."""
    stamps = made.stamps
    value = np.concatenate([run.acceleration for run in made.main])[:, 0]
    late = (ramp(stamps, made.source.origin_ns) - value) / SLOPE
    # at the jump of the ramp the difference is a whole span
    late = (late + SPAN_S / 2) % SPAN_S - SPAN_S / 2
    assert np.abs(late - latency_s).max() < late_s, (late.min(), late.max())
    assert (np.diff(stamps) > 0).all()
    # and each came once: it grows from one to the next
    grown = np.diff(value) % (SPAN_S * SLOPE)
    assert grown.min() > 0.4 * SLOPE / made.driver.rate_hz
    for run in made.main:
        np.testing.assert_allclose(run.acceleration[:, 2], 9.80665, atol=0.006)


@pytest.fixture
def starting(acquired, make_source):
    def make(name, kind='serial', rate_error=0.0, **settings):
        options = {'baud': settings['baud']} if 'baud' in settings else {}
        source = growing(make_source(rate_error=rate_error))
        return acquired(name, kind, options=options, source=source, **settings)

    return make


@pytest.fixture
def bench(starting):
    def make(*args, **settings):
        made = starting(*args, **settings).run(4.0)
        assert made.stats.state == 'running'
        return made

    return make


LATENCY_S = {'mti300': (0.0, 0.0015), 'bno055': (0.002, 0.0065)}
"""
Delay of the filters, and how far from it a stamp may be, s: with the clock of I²C stretched a look
at the BNO055 takes some 7 ms.  Its first samples are dated by the middle of a look, and stamps are
3.9 ms early to 6.5 ms late: a period, and what nobody knows of when the chip latches its words.
"""


def only_true_samples(made):
    assert_only_true_samples(made, *LATENCY_S[made.driver.name])


# --- without faults ----------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize('rate_error', [-0.008, 0.0, 0.008])
@every_line
def test_stamps_have_the_period_of_the_device(bench, name, kind, rate_error):
    made = bench(name, kind, rate_error)
    made.run(16.0)
    stats = made.stats
    assert stats.lost <= STRETCHED.get((name, kind), 0.0) * stats.samples
    assert not made.errors
    true_hz = made.driver.rate_hz * (1 + rate_error)
    assert stats.rate.value == pytest.approx(true_hz, rel=2e-4)
    intervals = np.diff(made.stamps[made.stamps > made.stamps[0] + 10 * 10**9])
    intervals = intervals[intervals < 1.5e9 / true_hz]
    assert np.abs(intervals - 1e9 / true_hz).max() < 20e3
    only_true_samples(made)


def test_a_serial_line_of_the_mti300_does_as_well_as_usb(bench):
    made = bench('mti300', baud=460_800)
    made.run(10.0)
    assert made.stats.lost == 0
    intervals = np.diff(made.stamps[-2000:])
    assert np.abs(intervals - 2.5e6).max() < 20e3
    assert_only_true_samples(made, 0.0, 2e-3)


def test_field_orientation_and_temperature_are_there(bench):
    made = bench('mti300')
    made.run(2.0)
    fields = [run for run in made.runs if run.magnetic_field is not None]
    temperatures = [run for run in made.runs if run.temperature is not None]
    assert sum(map(len, fields)) == pytest.approx(600, abs=60)
    assert sum(map(len, temperatures)) == pytest.approx(6, abs=1)
    assert made.main[-1].orientation is not None
    for run in fields:
        np.testing.assert_allclose(run.magnetic_field, [[20e-6, 0, -40e-6]] * len(run), rtol=1e-6)


# --- faults ------------------------------------------------------------------------------
LASTING = {
    # what is wrong: its names, its counter
    ('mti300', 'serial', 'no_answer'): ({NoAnswer}, 'bus_errors'),
    ('mti300', 'serial', 'unplugged'): ({NoAnswer}, 'bus_errors'),
    ('mti300', 'serial', 'garbage'): ({FrameError, ChecksumError}, 'garbage_bytes'),
    ('mti300', 'serial', 'stuck'): ({BusBusy}, 'bus_errors'),
    ('mti300', 'serial', 'permission_denied'): ({PermissionDenied}, 'bus_errors'),
    ('bno055', 'serial', 'no_answer'): ({NoAnswer}, 'bus_errors'),
    ('bno055', 'serial', 'unplugged'): ({NoAnswer}, 'bus_errors'),
    ('bno055', 'serial', 'garbage'): ({FrameError, NoAnswer}, 'uart_errors'),
    ('bno055', 'serial', 'permission_denied'): ({PermissionDenied}, 'bus_errors'),
    ('bno055', 'i2c', 'no_answer'): ({NoAnswer}, 'bus_errors'),
    ('bno055', 'i2c', 'garbage'): ({FrameError}, 'implausible'),
    ('bno055', 'i2c', 'stuck'): ({BusBusy}, 'bus_errors'),
}


@pytest.mark.parametrize(('name', 'kind', 'fault'), LASTING)
def test_a_lasting_fault_is_named_counted_and_survived(bench, name, kind, fault):
    errors, counter = LASTING[name, kind, fault]
    made = bench(name, kind)
    before = made.stamps
    made.bus.inject(fault, 0.6)
    made.run(0.6)
    end = made.clock.now_ns()
    made.run(4.0)
    assert made.errors & errors, made.texts
    assert made.driver.counters[counter] > 0
    assert made.acquisition.error is None
    back = made.stamps[made.stamps > end][0]
    assert (back - end) * 1e-9 < 2.0
    only_true_samples(made)
    # every sample of the time that passed came or is counted
    span = (made.stamps[-1] - before[0]) * 1e-9 * made.driver.rate_hz
    assert len(made.stamps) + made.stats.lost == pytest.approx(span + 1, abs=2)


@every_line
def test_a_brown_out_is_found_and_the_device_configured_again(bench, name, kind):
    made = bench(name, kind)
    made.bus.inject('brown_out')
    begin = made.clock.now_ns()
    made.run(4.0)
    # the BNO055 does not acknowledge its address while it starts
    assert made.driver.counters['brown_outs'] == 1 or (kind, made.errors) == ('i2c', {NoAnswer})
    assert made.acquisition.error is None
    gap = np.diff(made.stamps).max() * 1e-9
    assert gap < 2.0
    assert made.stamps[-1] > begin + 2 * 10**9
    only_true_samples(made)
    slack = 2 + STRETCHED.get((name, kind), 0.0) * made.stats.samples
    assert made.stats.lost == pytest.approx(gap * made.driver.rate_hz, abs=slack)


@pytest.mark.parametrize('fault', ['dropped_byte', 'half_frame', 'bit_error'])
def test_what_happens_once_to_the_mti300_costs_a_few_frames_that_are_counted(bench, fault):
    made = bench('mti300')
    n = len(made.stamps)
    made.bus.inject(fault)
    made.run(2.0)
    assert made.driver.continuity == 1
    assert made.acquisition.error is None
    lost = made.driver.counters['lost_frames']
    assert 1 <= lost <= 3
    assert made.stats.lost == lost
    assert len(made.stamps) + lost == pytest.approx(n + 800, abs=20)
    steps = np.rint(np.diff(made.stamps) / 2.5e6)
    assert steps.sum() - len(steps) == lost
    assert made.driver.counters['garbage_bytes'] > 0
    only_true_samples(made)


def test_bit_errors_cost_the_mti300_only_the_frames_they_are_in(bench):
    made = bench('mti300')
    made.bus.inject('bit_errors', 0.6)
    made.run(3.0)
    counters = made.driver.counters
    assert counters['checksum_errors'] > 5
    assert made.stats.lost == counters['lost_frames'] < 60
    assert made.acquisition.error is None
    only_true_samples(made)


@pytest.mark.parametrize('fault', ['dropped_byte', 'half_frame'])
def test_what_happens_once_to_the_bno055_is_asked_for_again(bench, fault):
    made = bench('bno055')
    for _ in range(20):
        made.bus.inject(fault)
        made.run(0.3)
    assert made.driver.counters['uart_errors'] >= 15
    assert made.acquisition.error is None
    # after each loss the phase of the samples is found anew: uncertain by a period at first
    assert_only_true_samples(made, 0.006, 0.0075)
    counted = made.driver.counters['lost_samples']
    assert made.stats.lost >= counted


def test_an_overrun_of_the_bno055_is_asked_for_again_and_costs_nothing(bench):
    made = bench('bno055')
    made.chip._overrun_every = 50
    made.run(10.0)
    assert made.driver.counters['uart_errors'] > 20
    assert made.stats.lost == 0
    assert not made.errors
    only_true_samples(made)


def test_frames_that_the_mti300_did_not_send_are_counted_by_its_counter(bench):
    made = bench('mti300')
    made.chip._source.rewind()
    made.chip._sent.frames += 7  # as when its line was too slow for seven frames
    made.chip._sent.made += 7
    made.run(0.5)
    assert made.driver.counters['lost_frames'] == 7
    assert made.stats.lost == 7
    assert not made.errors


def test_an_error_of_the_mti300_is_named(bench, clock):
    made = bench('mti300')
    made.chip._send(clock.now_ns(), 0x42, b'\x1e')
    made.run(2.0)
    assert any('0x1E, timer overflow' in text for text in made.texts)
    assert made.driver.counters['device_errors'] == 1
    assert made.acquisition.error is None
    only_true_samples(made)


@pytest.mark.parametrize('kind', ['serial', 'i2c'])
def test_a_system_error_of_the_bno055_is_named_and_ends_with_a_reset(bench, kind):
    made = bench('bno055', kind)
    memory = getattr(made.chip, 'chip', made.chip).memory
    driver = made.driver
    memory.put(driver.state, 1)
    memory.put(driver.error, 9)
    made.run(4.0)
    assert any('SYS_ERR fusion configuration' in text for text in made.texts)
    assert made.driver.counters['system_errors'] == 1
    assert made.acquisition.error is None
    assert made.stats.state == 'running'
    only_true_samples(made)


def test_another_device_is_refused(starting):
    for name in ('mti300', 'bno055'):
        made = starting(name)
        made.bus.inject('wrong_identity')
        made.run(2.0)
        assert IdentityError in made.errors
        assert not made.main
