# SPDX-License-Identifier: Apache-2.0
"""Drivers are found by their file; the base class does what every driver needs."""

from types import ModuleType
from typing import ClassVar

from imu_bench import drivers
from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, Driver, Identity, Setting
from imu_bench.errors import BusError, ConfigError, IdentityError, NoAnswer
from imu_bench.registers import Codes, Field, Register, Wait, Write
from imu_bench.simulation.clock import SimulatedClock
import pytest


class Tiny(Driver):
    name = 'tiny'
    title = 'Example Tiny'
    document = 'none'
    bus_kinds = ('i2c',)
    wiring: ClassVar = {'': Wiring(i2c_addresses=(0x10,))}

    ID = Register(0x0F, access='ro', reset=0x42)
    CTRL = Register(0x10)
    start_register = Register(0x11)
    accelerometer_range = Field(CTRL, (1, 0), Codes({2.0: 0, 4.0: 1}), 'g')
    identities = (Identity(ID, {0x42: 'Tiny'}, {0x41: 'Tinier, which has no range'}),)
    settings = (
        choice('accelerometer_range', accelerometer_range, 4.0, 'Full scale.'),
        Setting('rate_hz', 100.0, 'Rate.', (50.0, 100.0), unit='Hz'),
    )
    counter_names = ('losses',)
    reset_steps = (Wait(0.01),)
    start_steps = (Write({start_register: 1}),)
    stop_steps = (Write({start_register: 0}),)

    poll_period_s = 0.01

    def read(self):
        return []


def tiny(steps=(), **settings):
    return Tiny(ScriptedRegisters(steps), SimulatedClock(0), settings)


def rd(register, *answer):
    return ('read', register, len(answer)), bytes(answer)


def wr(register, *data):
    return ('write', register, bytes(data)), b''


def test_names_and_load_agree():
    assert 'mpu9250' in drivers.names()
    assert 'driver' not in drivers.names()
    for name in drivers.names():
        assert drivers.load(name).name == name


def test_an_unknown_driver_lists_those_there_are():
    with pytest.raises(ConfigError, match=r"no driver 'mpu9255'; there are .*mpu9250"):
        drivers.load('mpu9255')


def test_a_file_holds_one_driver(monkeypatch):
    monkeypatch.setattr(drivers, 'import_module', ModuleType)
    with pytest.raises(ConfigError, match='exactly one Driver, it has 0'):
        drivers.load('mpu9250')


def test_every_wrong_setting_is_named_at_once():
    with pytest.raises(ConfigError) as caught:
        tiny(accelerometer_range=3.0, rate=5)
    text = str(caught.value)
    assert 'accelerometer_range' in text
    assert '2, 4 g' in text
    assert 'rate_hz' in text


def test_defaults_and_counters_are_there_from_the_start():
    driver = tiny(rate_hz=50.0)
    assert driver.values == {'accelerometer_range': 4.0, 'rate_hz': 50.0}
    names = ('bus_errors', 'brown_outs', 'restarts', 'saturated', 'losses')
    assert driver.counters == dict.fromkeys(names, 0)
    assert driver.continuity == 0
    assert not driver.configured


CONFIGURE = (rd(0x0F, 0x42), rd(0x10, 0x80), wr(0x10, 0x81), rd(0x10, 0x81))


def test_configure_checks_writes_reads_back_and_compares():
    driver = tiny(CONFIGURE)
    driver.configure()
    assert driver.configured
    assert driver.clock.now_ns() == 10_000_000


def test_a_register_that_does_not_take_its_value_is_an_error():
    driver = tiny((*CONFIGURE[:3], rd(0x10, 0x80)))
    with pytest.raises(BusError, match=r'accelerometer_range .* 4\.0, .* 0x80; check wiring'):
        driver.configure()
    assert not driver.configured


@pytest.mark.parametrize(
    ('word', 'error', 'text'),
    [
        (0x41, IdentityError, r'0x41 \(Tinier, which has no range\), expected 0x42'),
        (0x55, IdentityError, r'0x55 \(not a part this driver knows\)'),
        (0xFF, NoAnswer, 'nothing drives the line'),
        (0x00, NoAnswer, 'nothing drives the line'),
    ],
)
def test_another_chip_is_refused(word, error, text):
    with pytest.raises(error, match=text):
        tiny((rd(0x0F, word),)).identify()


def test_starting_again_checks_the_settings_first():
    driver = tiny((*CONFIGURE, wr(0x11, 1), rd(0x10, 0x81), wr(0x11, 1)))
    driver.configure()
    driver.start()
    driver.restart()
    assert driver.continuity == 2
    assert driver.counters['brown_outs'] == 0


def test_a_chip_that_lost_its_settings_is_configured_again_and_counted_once():
    gone = ('read', 0x0F, 1), NoAnswer('gone')
    steps = (*CONFIGURE, rd(0x10, 0x00), gone, gone, *CONFIGURE, wr(0x11, 1))
    driver = tiny(steps)
    driver.configure()
    with pytest.raises(NoAnswer):
        driver.restart()
    assert not driver.configured
    driver.restart()
    assert driver.configured
    assert driver.counters['brown_outs'] == 1
    assert driver.counters['bus_errors'] == 2  # asked twice


def test_stop_and_close():
    bus = ScriptedRegisters([wr(0x11, 0)])
    driver = Tiny({'': bus}, SimulatedClock(0), {})
    driver.stop()
    driver.close()
    assert bus.closed
    assert driver.rates_hz == {}
