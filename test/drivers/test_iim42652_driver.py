# SPDX-License-Identifier: Apache-2.0
"""The IIM-42652 driver: registers and packets of DS-000401, start-up, every status flag."""

from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.drivers.iim42652 import Iim42652
from imu_bench.errors import BusError, ConfigError, FrameError, NoAnswer
from imu_bench.registers import Register
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

# DS-000401 rev. 1.2 section 13: bank, address, reset value
BANK_0 = """
11:00 13:05 14:00 16:00 1D:80 1E:00 1F:80 20:00 21:80 22:00 23:80 24:00 25:80 26:00 27:80 28:00
29:80 2A:00 2B:00 2C:00 2D:10 2E:00 2F:00 30:FF 37:00 38:00 4B:00 4C:30 4D:91 4E:00 4F:06 50:06
51:16 52:11 53:0D 54:23 5F:00 60:00 61:00 62:10 63:00 64:10 65:10 66:00 68:00 69:00 6C:00 6D:00
70:00 75:6F
"""
BANK_1 = '03:80 0B:A0 0C:0D 0D:AA 0E:80 62:00 63:00 64:00 7A:03 7B:20 7C:5F'
BANK_2 = '03:30 04:40 05:62'


def sheet(text, bank):
    pairs = (entry.split(':') for entry in text.split())
    return {(bank, int(address, 16)): int(value, 16) for address, value in pairs}


SHEET = {
    **sheet(BANK_0, 0),
    **sheet(BANK_1, 1),
    **dict.fromkeys((1, address) for address in range(0x0F, 0x14)),
    **sheet(BANK_2, 2),
    **{(4, address): 0 for address in range(0x77, 0x80)},
    (None, 0x76): 0,
}


def test_every_register_of_the_sheet_is_there():
    declared = {}
    for register in Iim42652.declared(Register).values():
        data = None if register.reset is None else register.pack(register.reset)
        for k in range(register.size):
            declared[register.bank, register.address + k] = None if data is None else data[k]
    assert declared == SHEET


# --- settings ----------------------------------------------------------------------------
def driver(steps=(), **settings):
    return Iim42652(ScriptedRegisters(steps), SimulatedClock(), settings)


# DS section 14.36: 500 Hz is not between 1000 and 200 Hz in the table
ODR = {
    32000.0: 1, 16000.0: 2, 8000.0: 3, 4000.0: 4, 2000.0: 5, 1000.0: 6, 500.0: 0xF, 200.0: 7,
    100.0: 8, 50.0: 9, 25.0: 10, 12.5: 11,
}  # fmt: skip


@pytest.mark.parametrize('rate', ODR)
def test_the_code_of_every_rate(rate):
    made = driver(rate_hz=rate)
    given = {field.name: field.encode(value) for field, value in made.assignments().items()}
    assert given['gyroscope_rate'] == given['accelerometer_rate'] == ODR[rate]
    fast = int(rate >= 4000)
    assert (given['short_pulse'], given['no_deassertion']) == (fast, fast)
    assert given['asynchronous_reset'] == 0
    assert made.rate_hz == rate
    # a quarter of 128 packets
    assert made.poll_period_s == pytest.approx(min(32 / rate, 0.25))


def test_the_orders_of_the_filters_and_the_full_scale_that_adapts_are_settings():
    given = driver(gyroscope_order=1, accelerometer_order=3, adaptive_full_scale=False)
    codes = {field.name: field.encode(value) for field, value in given.assignments().items()}
    assert (codes['gyroscope_order'], codes['accelerometer_order']) == (0, 2)
    assert codes['adaptive_full_scale'] == 1
    usual = {field.name: field.encode(value) for field, value in driver().assignments().items()}
    assert (usual['gyroscope_order'], usual['accelerometer_order']) == (1, 1)
    assert usual['adaptive_full_scale'] == 0x91 >> 6  # as after a reset


@pytest.mark.parametrize(
    ('settings', 'text'),
    [
        ({'gyroscope_order': 4}, 'gyroscope_order.*1, 2, 3'),
        ({'rate_hz': 400.0}, 'rate_hz.*12.5, 25, 50, 100, 200, 500, 1000'),
        ({'accelerometer_range': 3.0}, 'accelerometer_range.*16, 8, 4, 2 g'),
        ({'gyroscope_bandwidth': '92 Hz'}, 'gyroscope_bandwidth.*ODR/2, ODR/4'),
        ({'fifo_bits': 18}, 'fifo_bits.*16, 20'),
        ({'fifo_bits': 20, 'accelerometer_range': 2.0}, 'fifo_bits: 20 means.*they are 2 and'),
        ({'fifo_bits': 20, 'gyroscope_range': 125.0}, 'fifo_bits: 20 means.*16 and 125'),
    ],
)
def test_what_the_chip_does_not_have_is_refused(settings, text):
    with pytest.raises(ConfigError, match=text):
        driver(**settings)


# --- reading -----------------------------------------------------------------------------
def packet(tick, body='0000 0000 0800 00A4 FF5C 0000', header='68'):
    return bytes.fromhex(f'{header} {body} 00') + (tick & 0xFFFF).to_bytes(2, 'big')


BANK = ('write', 0x76, b'\x00'), b''
TEMPERATURE = ('read', 0x1D, 2), b'\x05\x2d'


def head(count, status=0x08):
    return ('read', 0x2D, 3), bytes([status]) + count.to_bytes(2, 'big')


def running(*steps, **settings):
    made = driver([BANK, *steps], rate_hz=1000.0, **settings)
    made.configured = True
    return made


def burst(data, status=0x08, tail=(TEMPERATURE,), extra=0):
    return [head(len(data) + extra, status), (('read', 0x30, len(data)), data), *tail]


def test_a_burst_is_decoded_and_stamped_backwards_from_the_count():
    made = running(*burst(packet(1000) + packet(1938) + packet(2875), extra=7))
    (run,) = made.read()
    now = made.clock.now_ns()
    assert run.stamps.tolist() == [now - 2_000_000, now - 1_000_000, now]
    np.testing.assert_allclose(run.acceleration, [[0, 0, 9.80665]] * 3)
    np.testing.assert_allclose(run.angular_velocity[0], [0.174533, -0.174533, 0], atol=1e-6)
    # DS section 4.13: 1325/132.48 + 25
    np.testing.assert_allclose(run.temperature, 35.0, atol=0.01)
    assert made.continuity == 0
    assert not +made.counters


def test_20_bits():
    data = bytes.fromhex('78 0000 FFFF 0800 00A3 FF5C 0000 052D 03E8 0C C4 00')
    made = running(*burst(data), fifo_bits=20)
    (run,) = made.read()
    # 32768 LSB/g and 262 LSB/(°/s): DS section 6.1
    np.testing.assert_allclose(run.acceleration, [[0, -4 / 32768 * 9.80665, 9.80665]])
    np.testing.assert_allclose(run.angular_velocity, [[0.174533, -0.174533, 0]], rtol=1e-5)


@pytest.mark.parametrize(
    ('body', 'bits'),
    [
        ('7FFF 0000 0000 0000 0000 0000', 16),
        ('0000 0000 0000 8002 0000 0000', 16),
        ('7FFF 0000 0000 0000 0000 0000', 20),
        ('0000 0000 0000 0000 8002 0000', 20),
    ],
)
def test_saturated_samples_are_counted_and_kept(body, bits):
    if bits == 16:
        data = packet(1000, body)
    else:
        data = bytes.fromhex(f'78 {body} 0000 03E8 00 00 00')
        data = data if '7FFF' not in body else data[:-3] + b'\xc0\x00\x00'
    made = running(*burst(data), fifo_bits=bits)
    assert len(made.read()[0]) == 1
    assert made.counters['saturated'] == 1


def test_nothing_new():
    made = running(head(15))
    assert made.read() == []
    assert not +made.counters


def test_a_sample_without_measurement_is_dropped():
    data = packet(1000, '8000 8000 8000 0000 0000 0000') + packet(1938)
    made = running(*burst(data))
    (run,) = made.read()
    assert len(run) == 1
    assert run.stamps.tolist() == [made.clock.now_ns()]
    assert made.counters['invalid'] == 1
    assert made.continuity == 1


def test_a_temperature_without_measurement_is_left_out():
    made = running(*burst(packet(1), tail=[(('read', 0x1D, 2), b'\x80\x00')]))
    assert made.read()[0].temperature is None


RESTART = [
    (('read', 0x16, 1), b'\x00'),
    (('write', 0x16, b'\x40'), b''),
    (('read', 0x4B, 1), b'\x00'),
    (('write', 0x4B, b'\x02'), b''),
    (('read', 0x2D, 1), b'\x00'),
]
LOST = ('read', 0x6C, 2), b'\x05\x01'


@pytest.mark.parametrize(
    'steps',
    [
        [head(2032, 0x0A)],  # full, said by the flag
        [head(2048)],  # full, said by the count
        burst(packet(1000) + packet(2875), tail=[]),  # a packet is missing by the chip's time
    ],
)
def test_an_overflow_empties_the_fifo_and_delivers_nothing(steps):
    made = running(*steps, LOST, *RESTART)
    assert made.read() == []
    made._wires[''].finish()
    assert made.counters['fifo_overflows'] == 1
    assert made.counters['packets_lost'] == 0x105
    assert made.continuity == 1


def test_a_packet_missing_between_two_bursts_is_noticed():
    made = running(*burst(packet(1000)), *burst(packet(2875), tail=[]), LOST, *RESTART)
    assert len(made.read()) == 1
    assert made.read() == []
    assert made.counters['fifo_overflows'] == 1


def test_a_wrong_header_is_named_and_the_fifo_emptied(monkeypatch):
    made = running(*burst(packet(1000) + packet(1938, header='40'), tail=[]))
    with pytest.raises(FrameError, match='script: FIFO packet with header 0x40 instead of 0x68'):
        made.read()
    assert made.counters['header_errors'] == 1
    calls = []
    monkeypatch.setattr(made, 'restart', lambda: calls.append(1))
    made._wires['']._steps = [head(0)]
    made.read()
    assert calls == [1]


def test_a_burst_that_broke_off_is_not_used(monkeypatch):
    made = running(head(16), (('read', 0x30, 16), NoAnswer('pulled')))
    with pytest.raises(NoAnswer):
        made.read()
    assert made.torn


def test_an_error_before_the_burst_costs_nothing():
    made = running((('read', 0x2D, 3), NoAnswer('glitch')), *burst(packet(1)))
    with pytest.raises(NoAnswer):
        made.read()
    assert len(made.read()) == 1
    assert made.continuity == 0


def test_an_impossible_count_is_an_error():
    with pytest.raises(BusError, match='FIFO_COUNT 65535 of 2080'):
        running(head(0xFFFF, 0xFF)).read()


def test_a_reset_behind_its_back_starts_everything_anew(monkeypatch):
    made = running(head(0, 0x10))
    calls = []
    monkeypatch.setattr(made, 'restart', lambda: calls.append(1))
    assert made.read() == []
    assert calls == [1]
