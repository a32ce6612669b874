# SPDX-License-Identifier: Apache-2.0
"""The BNO055 driver: order of the start-up, words, flags, doubts."""

import struct

from imu_bench.bus.scripted import ScriptedRegisters, ScriptedStream
from imu_bench.drivers.bno055 import Bno055
from imu_bench.errors import BusError, FrameError, IdentityError, NoAnswer, NotReady
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest


# --- conversation ------------------------------------------------------------------------
def read(register, answer):
    data = bytes.fromhex(answer)
    return ('read', register, len(data)), data


def write(register, data):
    return ('write', register, bytes.fromhex(data)), b''


PAGE_0, PAGE_1 = write(0x07, '00'), write(0x07, '01')
CONFIG = [PAGE_0, read(0x3D, '1c'), write(0x3D, '10')]
RESET = [  # what a reset would do, written
    *CONFIG,
    write(0x07, '00'),
    read(0x3E, '02'),
    write(0x3E, '00'),
    write(0x55, 18 * '00'),
    write(0x3F, '00'),
    read(0x38, '00'),
]
IDENTITY = [read(0x00, 'a0'), read(0x01, 'fb320f'), read(0x04, '0803')]
UNITS = [write(0x3B, '80'), write(0x41, '24'), write(0x42, '00'), PAGE_1]
UNITS_READ = [PAGE_0, read(0x3B, '80'), read(0x41, '24'), read(0x42, '00'), PAGE_1]
SELF_TEST = [PAGE_0, read(0x36, '0f')]
FUSED = [
    *RESET, *IDENTITY, *UNITS, read(0x08, '0d'), write(0x08, '0e'),
    *UNITS_READ, read(0x08, '0e'), *SELF_TEST,
]  # fmt: skip
PLAIN = [
    *RESET, *IDENTITY, *UNITS,
    write(0x08, '13'),  # 16 g, 125 Hz, normal
    read(0x0A, '38'), write(0x0A, '18'),  # 2000 °/s, 47 Hz
    read(0x09, '6d'), write(0x09, '0b'),  # 10 Hz, regular, normal
    read(0x0B, '00'), write(0x0B, '00'),
    *UNITS_READ, read(0x08, '13'), read(0x0A, '18'), read(0x09, '0b'), read(0x0B, '00'),
    *SELF_TEST,
]  # fmt: skip
AMG = {
    'mode': 'amg',
    'accelerometer_range': 16.0,
    'accelerometer_bandwidth': 125.0,
    'gyroscope_bandwidth': 47.0,
    'magnetometer_rate_hz': 10.0,
}


def status(celsius=25, calibration=0xFF, state=5, error=0):
    """Return TEMP to SYS_ERR."""
    return bytes([celsius, calibration, 0x0F, 0, 0, state, error])


def kept(**parts):
    """Return the housekeeping."""
    return read(0x34, status(**parts).hex())


def driver(*steps, **settings):
    return Bno055(ScriptedRegisters(steps), SimulatedClock(), settings)


@pytest.mark.parametrize(
    ('steps', 'settings'), [(FUSED, {'accelerometer_range': 8.0}), (PLAIN, AMG)]
)
def test_configuration_is_written_in_config_mode_read_back_and_compared(steps, settings):
    made = driver(*steps, **settings)
    start = made.clock.now_ns()
    made.configure()
    assert made.configured
    made._wires[''].finish()
    assert made.clock.now_ns() - start > 19_000_000  # to CONFIG


def test_what_the_chip_is():
    made = driver(PAGE_0, *IDENTITY)
    assert made.identify() == 'Bosch BNO055, firmware 3.08'


def test_another_chip_is_refused():
    with pytest.raises(IdentityError, match=r'CHIP_ID.* holds 0xD1.*expected 0xA0'):
        driver(PAGE_0, read(0x00, 'd1')).identify()
    with pytest.raises(IdentityError, match=r'ACC_MAG_GYR_ID.* holds 0xFA320F'):
        driver(PAGE_0, read(0x00, 'a0'), read(0x01, 'fa320f')).identify()


def test_a_setting_that_does_not_hold_is_an_error():
    # written outside CONFIG mode it would be ignored silently
    steps = [*FUSED[:-3], read(0x08, '0d')]
    with pytest.raises(BusError, match=r'ACC_CONFIG .* was set to 8.0, .* holds 0x0D'):
        driver(*steps, accelerometer_range=8.0).configure()


def test_a_failed_self_test_is_an_error():
    made = driver(*FUSED[:-1], read(0x36, '0b'), accelerometer_range=8.0)
    with pytest.raises(NotReady, match='self-test 0xB of 0xF'):
        made.configure()
    assert not made.configured
    assert made.counters['system_errors'] == 1


def after_an_error(*steps):
    made = driver(*steps, accelerometer_range=8.0)
    with pytest.raises(NotReady):
        made._give_up('SYS_ERR')
    return made


def test_only_after_an_error_the_chip_is_reset():
    silent = (('write', 0x3F, b' '), NoAnswer('no acknowledge'))
    booting = (('read', 0x00, 1), NoAnswer('starting'))
    made = after_an_error(
        *CONFIG, silent, booting, booting, read(0x00, 'a0'), *FUSED[1:],
    )  # fmt: skip
    start = made.clock.now_ns()
    made.configure()
    made._wires[''].finish()
    assert made.clock.now_ns() - start > 669_000_000  # DS table 0-2


def test_a_chip_that_hangs_after_a_reset_needs_its_supply_switched():
    class Hangs(ScriptedRegisters):
        def read(self, register, length):
            if register == 0x00:
                raise NoAnswer('script: nothing answers')
            return super().read(register, length)

    made = Bno055(Hangs([*CONFIG, write(0x3F, '20')]), SimulatedClock(), {})
    with pytest.raises(NotReady):
        made._give_up('SYS_ERR')
    with pytest.raises(NoAnswer, match=r'some BNO055 hang .*: switch it off and on, or set'):
        made.configure()


def test_the_crystal_is_waited_for():
    steps = [
        *FUSED, write(0x3F, '80'),
        read(0x38, '01'), read(0x38, '01'), read(0x38, '00'),
    ]  # fmt: skip
    made = driver(*steps, accelerometer_range=8.0, external_crystal=True)
    made.configure()
    made._wires[''].finish()


@pytest.mark.parametrize(('mode', 'word', 'state'), [('ndof', '1c', 5), ('amg', '17', 6)])
def test_starting_chooses_the_mode_and_sees_that_it_runs(mode, word, state):
    made = driver(PAGE_0, read(0x3D, '10'), write(0x3D, word), kept(state=state), mode=mode)
    made.configured = True
    made.start()
    assert made.continuity == 1
    made._wires[''].finish()


@pytest.mark.parametrize(
    ('state', 'error', 'text'),
    [
        (0, 0, 'does not run in mode ndof'),
        (6, 0, 'does not run in mode ndof'),
        (1, 9, 'SYS_ERR fusion configuration'),
        (1, 1, 'SYS_ERR peripheral initialisation'),
        (1, 10, 'SYS_ERR sensor configuration'),
    ],
)
def test_a_chip_that_does_not_run_is_named_and_configured_again(state, error, text):
    steps = PAGE_0, read(0x3D, '10'), write(0x3D, '1c'), kept(state=state, error=error)
    made = driver(*steps)
    made.configured = True
    with pytest.raises(NotReady, match=text):
        made.start()
    assert not made.configured
    assert made.counters['system_errors'] == 1


def test_stopping_goes_to_config():
    made = driver(PAGE_0, read(0x3D, '1c'), write(0x3D, '10'))
    made.stop()
    made._wires[''].finish()
    made.close()
    assert made._wires[''].closed


def test_without_fusion_the_mode_of_the_magnetometer_is_a_setting():
    made = driver(mode='amg', magnetometer_mode='high accuracy')
    assert made.assignments()[Bno055.magnetometer_mode] == 'high accuracy'


def test_rates_of_the_modes():
    assert driver(**AMG).rates_hz == {'temperature': 1.0, 'magnetic_field': 10.0}
    assert driver(mode='imu').rates_hz == {'temperature': 1.0}
    assert driver(mode='compass', rate_hz=20.0).poll_period_s == 0.65 / 20


# --- samples -----------------------------------------------------------------------------
def words(force=(0, 0, 981), field=(320, 0, -640), turn=(160, 0, -16), quaternion=None):
    """Return a burst from 0x08: little endian, Euler angles in front of the quaternion."""
    data = struct.pack('<9h', *force, *field, *turn)
    if quaternion is not None:
        data += struct.pack('<3h', 1, 2, 3) + struct.pack('<4h', *quaternion)
    return data


def look(**parts):
    return read(0x08, words(**parts).hex())


def look_up_to_the_status(**parts):
    return read(0x08, (words(quaternion=WEST) + bytes(12) + status(**parts)).hex())


WEST = (11585, 0, 0, 11585)  # 90° about z, 2**14 is 1


def running(*steps, **settings):
    made = driver(PAGE_0, *steps, **settings)
    made.configured = True
    made._kept_ns = made._begun_ns = made.clock.now_ns()
    return made


def test_words_of_a_fused_sample():
    made = running(look(quaternion=WEST))
    before = made.clock.now_ns()
    main, field = made.read()
    assert main.stamps[0] == before
    np.testing.assert_allclose(main.acceleration, [[0, 0, 9.81]])
    np.testing.assert_allclose(main.angular_velocity, np.radians([[10, 0, -1]]))
    np.testing.assert_allclose(main.orientation, [[0, 0, 0.7071, 0.7071]], atol=1e-4)
    np.testing.assert_allclose(field.magnetic_field, [[20e-6, 0, -40e-6]])
    made._wires[''].finish()


@pytest.mark.parametrize('mode', ['amg', 'accgyro', 'gyronly', 'maggyro'])
def test_without_fusion_the_range_of_the_gyroscope_is_2_to_the_15(mode):
    made = running(look(turn=(16384, 0, -32768)), mode=mode)
    found = next(run for run in made.read() if run.angular_velocity is not None)
    np.testing.assert_allclose(found.angular_velocity, np.radians([[1000, 0, -2000]]))
    assert made.counters['saturated'] == 1


@pytest.mark.parametrize(
    ('mode', 'quantities'),
    [
        ('acconly', {'acceleration'}),
        ('gyronly', {'angular_velocity'}),
        ('accgyro', {'acceleration', 'angular_velocity'}),
        ('amg', {'acceleration', 'angular_velocity', 'magnetic_field'}),
        ('maggyro', {'angular_velocity', 'magnetic_field'}),
    ],
)
def test_what_a_mode_does_not_measure_is_not_delivered(mode, quantities):
    made = running(look(), mode=mode)
    names = ('acceleration', 'angular_velocity', 'magnetic_field', 'orientation')
    found = {name for run in made.read() for name in names if getattr(run, name) is not None}
    assert found == quantities


def test_what_was_seen_before_is_not_delivered_again():
    same, other = look(quaternion=WEST), look(force=(1, 0, 981), quaternion=WEST)
    made = running(same, same, other)
    counts = []
    for _ in range(3):
        counts.append([len(run) for run in made.read()])
        made.clock.sleep(0.0065)
    # the field has not changed
    assert counts == [[1, 1], [], [1]]
    assert not +made.counters


def test_samples_that_came_and_went_are_counted():
    # looked at every 6.5 ms, then after 34.5 ms; a new sample every 10 ms, first at 3 ms
    times = [k * 6.5 for k in range(40)] + [39 * 6.5 + 34.5]
    numbers = [int((t + 7.0) // 10.0) for t in times]
    made = running(*(look(force=(k, 0, 981), quaternion=WEST) for k in numbers))
    taken = []
    for t, following in zip(times, [*times[1:], None], strict=True):
        taken += [run for run in made.read() if run.acceleration is not None]
        if following is not None:
            assert not made.skipped
            made.clock.sleep((following - t) * 1e-3)
    assert made.skipped == {0: 2}
    assert made.counters['lost_samples'] == 2
    found = [round(run.acceleration[0, 0] * 100) for run in taken]
    assert found == sorted(set(numbers))


def test_before_the_first_measurement_there_is_none():
    zero = (0, 0, 0)
    made = running(look(force=zero, field=zero, turn=zero, quaternion=(0, 0, 0, 0)), kept())
    assert [run.temperature.tolist() for run in made.read()] == [[25.0]]
    made._wires[''].finish()


@pytest.mark.parametrize(
    'parts',
    [
        {'force': (4500, 0, 0)},  # far beyond ±4 g
        {'force': (0, -32768, 0)},
        {'quaternion': (11585, 0, 0, 12585)},
        {'quaternion': (-1, -1, -1, -1)},
    ],
)
def test_words_that_no_chip_sends_are_refused(parts):
    good = look(quaternion=WEST)
    made = running(good, look(**{'quaternion': WEST, **parts}), good)
    made.read()
    with pytest.raises(FrameError, match=r'words that no BNO055 sends; .*i2c-gpio'):
        made.read()
    assert made.counters['implausible'] == 1
    # what was taken before is not taken again
    assert made.read() == []


@pytest.mark.parametrize(
    'parts',
    [
        {'force': (3922, 0, 0)},
        {'force': (0, -3923, 0)},
        # 4 g are 3924 in Linux; another 2 % of scale error
        {'force': (3924, 0, 0)},
        {'force': (0, -4002, 0)},
        {'turn': (0, 32000, 0)},
    ],
)
def test_full_scale_is_counted_as_saturation(parts):
    made = running(look(quaternion=WEST, **parts))
    made.read()
    assert made.counters['saturated'] == 1


def test_temperature_and_status_are_looked_at_once_a_second():
    made = running(look_up_to_the_status(celsius=0xF6, calibration=0x3F), look(quaternion=WEST))
    made.clock.sleep(1.01)
    runs = made.read()
    assert runs[-1].temperature.tolist() == [-10.0]
    # the upper two bits of CALIB_STAT are zero
    assert made.counters['uncalibrated'] == 1
    assert len(made.read()) == 0
    made._wires[''].finish()


def test_a_system_error_is_named_and_the_chip_reset():
    made = running(look_up_to_the_status(state=1, error=9))
    made.clock.sleep(1.01)
    with pytest.raises(NotReady, match='SYS_ERR fusion configuration; configuring again'):
        made.read()
    assert made.counters['system_errors'] == 1
    assert not made.configured


def test_a_chip_that_was_without_power_is_configured_before_it_is_read_again():
    zeros = read(0x08, bytes(32).hex())
    mode = read(0x3D, '10')
    made = running(
        zeros, kept(state=0), mode, *FUSED, mode, write(0x3D, '1c'), kept(),
        accelerometer_range=8.0,
    )  # fmt: skip
    assert made.read() == []
    assert made.counters['brown_outs'] == 1
    assert made.continuity == 1
    made._wires[''].finish()


# --- serial line -------------------------------------------------------------------------
def test_on_a_serial_line_the_same_registers_are_behind_its_protocol():
    # DS section 4.7: AA, 00 write or 01 read, register, length, data; EE 01 or BB, length, data
    data = words(quaternion=WEST)
    steps = [
        (bytes.fromhex('aa00070100'), bytes.fromhex('ee01')),
        (bytes.fromhex('aa010820'), bytes.fromhex('ee07')),  # overrun: once more
        (bytes.fromhex('aa010820'), bytes([0xBB, 0x20]) + data),
    ]
    line = ScriptedStream(steps)
    made = Bno055(line, SimulatedClock(), {})
    made.configured = True
    made._kept_ns = made.clock.now_ns()
    main, _ = made.read()
    np.testing.assert_allclose(main.acceleration, [[0, 0, 9.81]])
    assert made.counters['uart_errors'] == 1
    line.finish()
