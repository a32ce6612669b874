# SPDX-License-Identifier: Apache-2.0
"""The SCL3300 driver: frames of the data sheet, order of the start-up, every status flag."""

import math

from imu_bench.bus.scripted import ScriptedFrames
from imu_bench.drivers.scl3300 import Scl3300
from imu_bench.errors import ConfigError, FrameError, IdentityError, NotReady
from imu_bench.registers import Register
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

# Doc 4921 rev. 2 table 15: (bank, address) to reset value; bank None is both
SHEET = {
    **{(None, address): None for address in range(0x01, 0x06)},
    (None, 0x06): 0x10,
    (0, 0x07): 0,
    (0, 0x08): 0x10,
    **{(0, address): 0 for address in range(0x09, 0x0E)},
    (0, 0x10): 0xC1,
    (1, 0x19): None,
    (1, 0x1A): None,
    (None, 0x1F): 0,
}


def test_every_register_of_the_sheet_is_there():
    declared = {}
    for register in Scl3300.declared(Register).values():
        for k in range(register.size // 2):
            declared[register.bank, register.address + k] = register.reset
    assert declared == SHEET


def test_writable_registers_are_those_of_the_sheet():
    writable = {r.address for r in Scl3300.declared(Register).values() if r.writable}
    assert writable == {0x0C, 0x0D, 0x1F}


# --- frames ------------------------------------------------------------------------------
def checksum(body):
    crc = 0xFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def frame(first, word):
    body = bytes([first, word >> 8 & 0xFF, word & 0xFF])
    return body + bytes([checksum(body)])


def script(*steps):
    """Return steps whose texts are frames; '' is an answer nobody looks at."""
    return [(bytes.fromhex(out), bytes.fromhex(back or '00000000')) for out, back in steps]


SWEEP = (
    '040000F7', '080000FD', '0C0000FB', '100000E9', '140000EF',
    '240000C7', '280000CD', '2C0000CB', '180000E5', '40000091',
)  # fmt: skip


def sweep(words=(220, 0, 6000, 5, 0x161E, 0x0F88, 0, 0), status=0, rs=1, last=None):
    """Return a sweep: words of X, Y, Z, STO, temperature, angles, then STATUS."""
    answers = [
        frame(int(out[:2], 16) | rs, word).hex()
        for out, word in zip(SWEEP[:-2], words, strict=True)
    ]
    answers.append(frame(0x18 | (rs if last is None else last), status).hex())
    return script(*zip(SWEEP, ['', *answers], strict=True))


def driver(steps=(), **settings):
    made = Scl3300(ScriptedFrames(steps), SimulatedClock(), {'mode': 1, **settings})
    made.configured = True
    return made


def read(steps, **settings):
    made = driver(steps, **settings)
    runs = made.read()
    made._wires[''].finish()
    return made, runs


def test_a_sweep_becomes_a_sample_in_si_units():
    made, (run,) = read(sweep())
    # DS sections 2.5, 2.6, 2.11: 220 and 6000 of 6000 LSB/g, 5662/18.9 - 273, 3976·90/2^14
    np.testing.assert_allclose(run.acceleration, [[0.359577, 0, 9.80665]], rtol=1e-5)
    np.testing.assert_allclose(run.temperature, [26.577], atol=1e-3)
    np.testing.assert_allclose(run.inclination, [[math.radians(21.8408), 0, 0]], atol=1e-5)
    assert run.angular_velocity is None
    assert run.stamps.tolist() == [made.clock.now_ns()]
    assert not +made.counters


@pytest.mark.parametrize(('mode', 'z'), [(1, 9.80665), (2, 19.6133), (3, 4.903325), (4, 4.903325)])
def test_sensitivity_follows_the_mode(mode, z):
    _, (run,) = read(sweep(), mode=mode)
    assert run.acceleration[0, 2] == pytest.approx(z)


def test_the_stamp_lies_between_the_axes():
    class Timed:
        name = 'timed'
        steps = sweep()

        def transfer(self, out):
            clock.sleep(1e-3)
            expected, back = self.steps.pop(0)
            assert out == expected
            return back

    clock = SimulatedClock()
    made = Scl3300(Timed(), clock, {'mode': 1})
    made.configured = True
    start = clock.now_ns()
    (run,) = made.read()
    # X is latched 1 ms after the start, Y after 2, Z after 3
    assert run.stamps.tolist() == [start + 2_000_000]


def test_it_is_paced_by_the_host():
    made = driver(rate_hz=500.0)
    assert made.paced
    assert made.poll_period_s == 0.002
    assert made.rate_hz == 500.0


# --- flags -------------------------------------------------------------------------------
def test_a_saturated_sample_is_kept_and_counted_and_has_no_angles():
    made, (run,) = read(sweep(status=0x40, rs=3))
    assert made.counters['saturated'] == 1
    assert run.acceleration[0, 2] == pytest.approx(9.80665)
    assert np.isnan(run.inclination).all()


def test_a_flag_raised_during_the_last_answer_waits_for_the_next_sweep():
    made, (run,) = read(sweep(last=3))
    assert not +made.counters
    assert np.isfinite(run.inclination).all()


def test_an_invalid_temperature_is_left_out():
    made, (run,) = read(sweep(status=0x20, rs=3))
    assert run.temperature is None
    assert made.counters['temperature_saturated'] == 1


@pytest.mark.parametrize(
    ('status', 'name'),
    [
        (0x200, 'digital error 1'),
        (0x100, 'digital error 2'),
        (0x80, 'clock error'),
        (0x08, 'memory error'),
        (0x01, 'pin error'),
    ],
)
def test_a_defect_is_named_with_the_error_flags_and_the_chip_reset(status, name):
    # the error flags are read in bank 0, each in an exchange of its own
    after = script(
        ('FC000073', '4100C136'),
        ('1C0000E3', frame(0xFD, 0).hex()),
        ('40000091', frame(0x1D, 0x0800).hex()),
        ('200000C1', '4100C136'),
        ('40000091', frame(0x21, 0x0010).hex()),
    )
    made = driver(sweep(status=status, rs=3) + after)
    with pytest.raises(NotReady, match=f'({name}).*ERR_FLAG1 0x0800, ERR_FLAG2 0x0010; reset'):
        made.read()
    assert made.counters['chip_errors'] == 1
    assert not made.configured
    assert made.continuity == 1


@pytest.mark.parametrize(('status', 'rs'), [(0x10, 3), (0x02, 3), (0x04, 3), (0x00, 0)])
def test_lost_settings_start_everything_anew(monkeypatch, status, rs):
    made = driver(sweep(status=status, rs=rs))
    calls = []
    monkeypatch.setattr(made, 'restart', lambda: calls.append(made.configured))
    assert made.read() == []
    assert made.counters['brown_outs'] == 1
    assert calls == [False]


def test_an_error_status_without_a_flag_is_a_request_that_arrived_broken():
    made = driver(sweep(rs=3))
    with pytest.raises(FrameError, match='a request arrived broken'):
        made.read()
    assert made.counters['frame_errors'] == 1


@pytest.mark.parametrize(('mode', 'limit'), [(1, 1800), (2, 900), (3, 3600), (4, 3600)])
def test_the_self_test_output_is_watched(mode, limit):
    def words(sto):
        return (220, 0, 6000, sto & 0xFFFF, 0x161E, 0, 0, 0)

    fine, bad = sweep(words(-limit)), sweep(words(limit + 1))
    made = driver(mode=mode)
    for n, steps in enumerate((fine, bad, bad, fine, bad)):
        if n:
            steps[0] = (steps[0][0], bytes.fromhex('4100C136'))
        made._frames._frames = ScriptedFrames(steps)
        made.clock.sleep(0.9)
        assert len(made.read()) == 1
    assert made.counters['self_test_exceeded'] == 3
    bad[0] = (bad[0][0], bytes.fromhex('4100C136'))
    made._frames._frames = ScriptedFrames(bad)
    made.clock.sleep(1.1)
    with pytest.raises(NotReady, match=f'self-test output stays beyond ±{limit}'):
        made.read()
    assert not made.configured


# --- start-up ----------------------------------------------------------------------------
def test_the_start_up_of_the_document(monkeypatch):
    """DS table 11: reset, mode, angles, settling, STATUS three times; here with read-back."""
    steps = script(
        ('FC000073', ''),  # bank 0
        ('B4002098', frame(0xFD, 0).hex()),
        ('40000091', ''),
        ('40000091', frame(0x43, 0xC1).hex()),
        ('FC00016E', frame(0x43, 0xC1).hex()),  # bank 1: serial number
        ('680000AD', frame(0xFF, 1).hex()),
        ('40000091', '693CE54F'),
        ('640000A7', frame(0x43, 0).hex()),
        ('40000091', '65F7DA19'),
        ('FC000073', frame(0x43, 0).hex()),
        ('40000091', frame(0xFF, 0).hex()),
        ('40000091', frame(0x43, 0xC1).hex()),
        ('B4000338', frame(0x43, 0xC1).hex()),  # mode 4
        ('B0001F6F', frame(0xB7, 3).hex()),
        ('340000DF', frame(0xB3, 0x1F).hex()),
        ('40000091', '35000377'),
        ('180000E5', frame(0x43, 0xC1).hex()),
        ('180000E5', frame(0x1B, 0x12).hex()),
        ('180000E5', frame(0x19, 0x12).hex()),
        ('40000091', '1900006A'),
    )
    made = Scl3300(ScriptedFrames(steps), SimulatedClock(), {'mode': 4})
    before = made.clock.now_ns()
    made.configure()
    made._wires[''].finish()
    assert made.clock.now_ns() - before == 26_000_000 + 100_000_000
    assert made.configured
    assert not +made.counters


def identified(word):
    steps = script(('FC000073', ''), ('40000091', frame(0xFD, 0).hex()),
                   ('40000091', frame(0x41, word).hex()))  # fmt: skip
    return driver(steps)


def test_the_sister_part_is_refused():
    with pytest.raises(IdentityError, match=r'0x51 .SCA3300.*expected 0xC1'):
        identified(0x51).identify()


@pytest.mark.parametrize(
    ('name', 'value', 'allowed'),
    [('mode', 5, '1, 2, 3, 4'), ('mode', '4', '1, 2, 3, 4'), ('rate_hz', 2001.0, '1 to 2000 Hz')],
)
def test_what_the_chip_does_not_have_is_refused(name, value, allowed):
    with pytest.raises(ConfigError, match=f'{name}.*{allowed}'):
        driver(**{name: value})
