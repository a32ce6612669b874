# SPDX-License-Identifier: Apache-2.0
"""
Every fault on every driver and bus; a new driver is tested without a line of editing here.

The acceleration is a triangle in time, so that every sample says when it was measured: what
the emulated chip did not measure, or measured at another time, is found by its value.
"""

from collections import Counter
from dataclasses import replace
import re
import zlib

from imu_bench.acquisition import Acquisition
from imu_bench.config.faults import KINDS, ONCE
from imu_bench.drivers import load, names
from imu_bench.drivers.driver import PolledDriver
from imu_bench.emulators import create
from imu_bench.emulators.faults import possible, wrap
from imu_bench.emulators.line import Line, Timing
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

BUSES = [(name, kind) for name in names() for kind in load(name).bus_kinds]
CASES = [
    pytest.param(name, kind, fault, id=f'{name}-{kind}-{fault}')
    for name, kind in BUSES
    for fault in possible(load(name), kind)
]
BEFORE_S, FAULT_S, AFTER_S = 4.0, 1.0, 1.5
RECOVERY_S = 2.0
POWER_LOST = ('unplugged', 'brown_out', 'wrong_identity')

# the name of an error that has to be among those of a fault, and what its text says
ERRORS = {
    'no_answer': ('NoAnswer', 'nothing (answers|drives)|no (acknowledge|data)'),
    'unplugged': ('NoAnswer', 'nothing (answers|drives)|no (acknowledge|data)'),
    'stuck': ('BusBusy', 'stuck'),
    'stretched': ('BusBusy', 'stretched for more than 35 ms'),
    'permission_denied': ('PermissionDenied', 'may not open'),
    'wrong_identity': ('IdentityError', 'expected .* for '),
}
# counters that grow without any fault
QUIET = {'uncalibrated', 'repeated', 'saturated', 'filter_invalid'}


class Triangle:
    """A source whose acceleration along y and z goes up and down evenly; x holds still."""

    def __init__(self, clock, slope, amplitude, rate_error=2e-3):
        self.slope, self.amplitude = slope, amplitude
        self.rate_error = rate_error
        self.origin_ns = clock.now_ns()
        self.restart(clock.now_ns(), 1000.0)

    def restart(self, t_ns, nominal_hz=None):
        self.nominal_hz = nominal_hz or getattr(self, 'nominal_hz', 1000.0)
        self.period_ns = 1e9 / (self.nominal_hz * (1 + self.rate_error))
        self.anchor_ns, self.made = t_ns, 0

    def acceleration(self, stamps):
        """Return what is measured at a time, m/s²."""
        quarter = self.amplitude / self.slope
        phase = ((np.asarray(stamps) - self.origin_ns) * 1e-9 / quarter) % 4.0
        return self.amplitude * (1.0 - np.abs(phase - 2.0))

    def samples_ahead(self, t_ns):
        # what costs by the call is paid for many samples at once, as with a simulated sensor
        return self.samples_until(t_ns + round(64 * self.period_ns))

    def samples_until(self, t_ns):
        due = max(int((t_ns - self.anchor_ns) / self.period_ns + 1e-9), self.made)
        k = np.arange(self.made + 1, due + 1)
        self.made = due
        stamps = self.anchor_ns + np.rint(k * self.period_ns).astype(np.int64)
        moving, n = self.acceleration(stamps), len(k)
        return Samples(
            stamps,
            np.column_stack([np.full(n, 3.0), moving, moving]),
            np.broadcast_to((0.1, 0.0, -0.1), (n, 3)),
            magnetic_field=np.broadcast_to((20e-6, 0.0, -40e-6), (n, 3)),
            temperature=np.full(n, 25.0),
        )


def on_desk(name, kind, source, clock):
    """Return the buses; a clock that is stretched would cost samples without any fault."""
    if kind != 'i2c':
        return create(name, kind, source, clock)
    line = Line(clock, replace(Timing.i2c(), stretchable=False))
    return create(name, kind, source, clock, line=line)


class Desk:
    """A driver on an emulated bus that can be disturbed, its acquisition, and what came of it."""

    def __init__(self, name, kind):
        self.clock = clock = SimulatedClock()
        driver = load(name)
        channel = next(
            c for c in driver.channels_on(kind).values() if c.quantity == 'acceleration'
        )
        probe = Triangle(clock, 1.0, 1.0)
        made = driver(on_desk(name, kind, probe, clock), clock, {})
        range_ = made.values.get(channel.scaled_by.name) if channel.scaled_by else None
        self.lsb = channel.resolution(range_).max() if channel.quantised else 1e-4
        if channel.quantised:
            full = channel.limits_at(range_)[1] * self.lsb
        else:
            full = driver.typical['acceleration'].range or 160.0
        amplitude = 0.6 * min(full, 160.0)
        slope = np.clip(4 * self.lsb * made.rate_hz, 2 * amplitude / 10, 2 * amplitude)
        self.source = Triangle(clock, slope, amplitude)
        self.wires = wrap(on_desk(name, kind, self.source, clock), driver, clock)
        clock.sleep(driver.start_up_s)
        self.driver = driver(self.wires, clock, {})
        self.acquisition = Acquisition(self.driver, clock, name=name)
        self.runs, self.texts = [], set()

    def run(self, seconds, until=lambda: False):
        """Advance in small steps; end early when something is true; return how long it took."""
        start = self.clock.now_ns()
        end = start + round(seconds * 1e9)
        while (now := self.clock.now_ns()) < end and not until():
            self.acquisition.advance(min(now + 10_000_000, end))
            self.collect()
        return (self.clock.now_ns() - start) * 1e-9

    def collect(self):
        self.runs += [run for run in self.acquisition.drain() if run.acceleration is not None]
        if self.acquisition.error is not None:
            self.texts.add(str(self.acquisition.error))

    def is_well_since(self, t_ns):
        """Return whether a sample that was measured after a time has arrived, and all is well."""
        arrived = self.runs and self.runs[-1].stamps[-1] > t_ns
        return arrived and self.acquisition.error is None and self.stats.state == 'running'

    @property
    def stats(self):
        return self.acquisition.stats

    @property
    def period_ns(self):
        error = 0.0 if self.driver.paced else self.source.rate_error
        return 1e9 / self.driver.rate_hz / (1 + error)

    @property
    def stamps(self):
        return np.concatenate([run.stamps for run in self.runs])

    def stamps_of_wrong_values(self, healthy):
        """Return when samples were stamped whose values the chip did not have then."""
        stamps = self.stamps
        values = np.concatenate([run.acceleration[:, 2] for run in self.runs])
        truth = self.source.acceleration
        rising = np.sign(truth(stamps + 100_000) - truth(stamps - 100_000))
        # a filter delays everything alike; how much is seen before the fault
        late = (truth(stamps) - values)[:healthy] / self.source.slope * rising[:healthy]
        expected = truth(stamps - np.median(late) * 1e9)
        tolerance = self.source.slope * 0.75 * self.period_ns * 1e-9 + self.lsb
        return stamps[np.abs(values - expected) > tolerance]

    def disturb(self, fault, for_s):
        """Inject a fault into every wire; return its beginning and end."""
        begin = self.clock.now_ns()
        for wire in self.wires.values():
            wire.inject(fault, for_s)
        return begin, begin + (0 if fault in ONCE else round(for_s * 1e9))


def grown(after, before):
    return {name: count - before.get(name, 0) for name, count in after.items()}


def played(name, kind, fault, offset_s):
    """Return a desk on which a fault has come and gone, and what is known of it."""
    desk = Desk(name, kind)
    desk.run(15.0, lambda: desk.is_well_since(0))
    desk.run(BEFORE_S + offset_s)
    before, healthy = desk.stats, len(desk.stamps)
    begin, end = desk.disturb(fault, FAULT_S)
    desk.run((end - begin) * 1e-9 + 0.02)
    desk.run(9.0, lambda: desk.is_well_since(end))
    recovered, took_s = desk.stats, (desk.clock.now_ns() - end) * 1e-9
    desk.run(AFTER_S)
    assert desk.is_well_since(end)
    held = desk.driver.registers.difference(desk.driver.assignments())
    desk.acquisition.finish()
    desk.collect()
    return desk, before, recovered, healthy, (begin, end), took_s, held


def check(name, kind, fault, offset_s):
    desk, before, recovered, healthy, (begin, end), took_s, held = played(
        name, kind, fault, offset_s
    )
    after = desk.stats

    # a named error and a counter
    errors = +Counter(grown(after.errors, before.errors))
    counters = {k: n for k, n in grown(after.counters, before.counters).items() if n > 0}
    assert sum(errors.values()) == after.failures - before.failures
    lost = after.lost - before.lost
    if fault in ERRORS:
        named, says = ERRORS[fault]
        assert named in errors
        assert any(re.search(says, text) for text in desk.texts), desk.texts
    assert all(desk.driver.name in text for text in desk.texts), desk.texts
    protected = any(re.search('crc|checksum', counter) for counter in after.counters)
    if protected and (fault == 'bit_errors' or (fault == 'bit_error' and lost)):
        assert any(re.search('crc|checksum', counter) for counter in counters)
    if fault in ('dropped_byte', 'half_frame'):
        assert any(re.search('checksum|garbage|uart', counter) for counter in counters)
    assert not lost or errors or set(counters) - QUIET or fault == 'stall'

    # recovery by itself, in time, to the settings as they were
    allowed_s = RECOVERY_S + (desk.driver.settling_s if fault in POWER_LOST else 0.0)
    assert took_s <= allowed_s
    assert after.failures == recovered.failures
    # where nothing but the pace tells samples apart, one may be found missing later
    assert after.lost - recovered.lost <= isinstance(desk.driver, PolledDriver)
    assert held == ''

    # every sample of the chip arrived once, or is counted as lost
    stamps = desk.stamps
    assert (np.diff(stamps) > (0.0 if desk.driver.paced else 0.5 * desk.period_ns)).all()
    undetectable = fault in ('bit_error', 'bit_errors') and not protected
    true_lost = round((stamps[-1] - stamps[0]) / desk.period_ns) + 1 - len(stamps)
    # of wrong words some may pass for updates where there is nothing else to tell them by
    off = 5 if undetectable and isinstance(desk.driver, PolledDriver) else 1
    if fault == 'busy':  # many gaps, of which each is rounded to whole samples
        off = np.count_nonzero(np.diff(stamps) > 1.5 * desk.period_ns)
    assert abs(lost - true_lost) <= off, f'{lost} counted, {true_lost} true'

    # and none that the chip did not measure
    wrong = desk.stamps_of_wrong_values(healthy)
    if undetectable:
        # a pace that was learnt from wrong words goes on for a while: see docs/faults.md
        allowed_ns = 10e9 if isinstance(desk.driver, PolledDriver) else 1e8
        assert ((begin - 1e8 < wrong) & (wrong < end + allowed_ns)).all()
        assert fault == 'bit_errors' or len(wrong) <= len(desk.wires)
    else:
        assert not len(wrong), (wrong - begin) * 1e-9


@pytest.mark.parametrize(('name', 'kind', 'fault'), CASES)
def test_a_fault_is_named_counted_and_outlived_without_an_invented_sample(name, kind, fault):
    check(name, kind, fault, offset_s=zlib.crc32(f'{name} {kind} {fault}'.encode()) % 997 * 1e-4)


@pytest.mark.thorough
@pytest.mark.parametrize('offset_s', [1e-3, 2.37e-3, 5.1e-3, 0.0119, 0.0421])
@pytest.mark.parametrize(('name', 'kind', 'fault'), CASES)
def test_whenever_it_begins(name, kind, fault, offset_s):
    check(name, kind, fault, offset_s)


def test_every_kind_of_fault_is_played():
    assert {case.values[2] for case in CASES} == set(KINDS)
