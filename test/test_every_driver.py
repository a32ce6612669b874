# SPDX-License-Identifier: Apache-2.0
"""
House rules for every driver there is; a new one is tested without a line of editing here.

Values go from SI through the emulated chip and the driver back to SI.  What the tables of a
driver say is held against its witnesses, which come from documents.
"""

import inspect
import math
from pathlib import Path
import re
import subprocess
import sys

from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from imu_bench.config import load_sensor
from imu_bench.config.schema import Setting
from imu_bench.drivers import load, names
from imu_bench.drivers.driver import Driver
from imu_bench.emulators import create
from imu_bench.errors import ConfigError
from imu_bench.registers import Field, Frame, Register, Until, Write
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
NAMES = names()
CASES = [(name, kind) for name in NAMES for kind in load(name).bus_kinds]
SECTIONS = ('name', 'title', 'document', 'bus_kinds', 'wiring', 'typical', 'witnesses')
HEADINGS = ('document', 'register', 'fields', 'channels', 'sequences', 'typical', 'witnesses')

UNHEARD_OF = {
    'float': (0.123456, 1e9),
    'int': (-7, 10**9),
    'str': ('', 'no such thing'),
    'bool': (1, 'no such thing'),
}
"""Values that no datasheet has, by kind of setting."""

every_driver = pytest.mark.parametrize('driver', [load(name) for name in NAMES], ids=NAMES)
every_bus = pytest.mark.parametrize(('name', 'kind'), CASES)


def limits(driver, channel, range_):
    """Return the smallest and largest reading; of a chip that sends floats its full range."""
    if channel.quantised:
        low, high = channel.limits_at(range_)
        return low - getattr(channel, 'zero', 0), high - getattr(channel, 'zero', 0)
    full = getattr(driver.typical.get(channel.quantity), 'range', None) or math.inf
    full /= channel.resolution(range_).max()
    return -full, full


def precision(channel, range_, values):
    """Return how well values can come through: half an LSB, or a rounded float."""
    half = channel.resolution(range_) / 2
    if channel.quantised:
        return half
    return np.abs(values) * np.finfo(np.dtype(channel.dtype)).eps + 1e-12


def channels(driver, kind=None):
    return driver.channels() if kind is None else driver.channels_on(kind)


# --- declarations ------------------------------------------------------------------------
def test_there_are_drivers():
    assert NAMES


@pytest.mark.parametrize('name', NAMES)
def test_imports_without_hardware_libraries(name):
    code = (
        'import sys\n'
        "for blocked in ('smbus2', 'periphery', 'serial', 'rclpy', 'daqhats'):\n"
        '    sys.modules[blocked] = None\n'
        'from imu_bench.drivers import load\n'
        f'print(load({name!r}).title)\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == load(name).title


@every_driver
def test_the_file_has_the_sections_of_the_house(driver):
    own = vars(driver)
    missing = [section for section in SECTIONS if section not in own]
    assert not missing
    assert driver.name == driver.__module__.rpartition('.')[2]
    assert set(driver.bus_kinds) <= {'i2c', 'spi', 'frame', 'serial', 'daqhat'}
    assert '' in driver.wiring
    headings = re.findall(r'^    # --- (\w+)', inspect.getsource(driver), re.MULTILINE)
    known = [heading for heading in headings if heading in HEADINGS]
    assert known == sorted(known, key=HEADINGS.index)
    assert {'document', 'channels', 'typical', 'witnesses'} <= set(known)


@every_driver
def test_codes_are_one_to_one_and_fit(driver):
    for name, field in driver.declared(Field).items():
        codes = field.codes.all_codes if field.codes else ()
        assert len(set(codes)) == len(codes), name
        assert all(0 <= code < 2**field.width for code in codes), name
        for value in field.allowed[:300]:
            assert field.decode(field.encode(value)) == value, name


@every_driver
def test_fields_fit_and_do_not_overlap(driver):
    taken = {}
    for name, field in driver.declared(Field).items():
        assert 0 <= field.low <= field.high < 8 * field.register.size, name
        for bit in range(field.low, field.high + 1):
            place = field.register, bit
            assert place not in taken, f'{name} and {taken.get(place)} share bit {bit}'
            taken[place] = name


@every_driver
def test_sequences_only_touch_what_can_be_written(driver):
    for name, steps in driver.sequences().items():
        for step in steps:
            if isinstance(step, Write):
                for register in step.by_register():
                    assert register.access in ('rw', 'wo'), f'{name}: {register}'
            if isinstance(step, Until):
                assert step.field.register.access != 'wo', f'{name}: {step.field}'
                assert 0 < step.timeout_s < 10


@every_driver
def test_settings_are_declared_whole(driver):
    for setting in driver.settings:
        assert isinstance(setting, Setting)
        assert setting.description.endswith('.'), setting.name
        assert setting.check(setting.default) == setting.default
        for value in setting.allowed:
            assert type(value) is type(setting.default), setting.name
            driver.check_settings({setting.name: value})
    assert len({setting.name for setting in driver.settings}) == len(driver.settings)


@every_driver
def test_what_is_not_in_the_datasheet_is_refused_with_what_is(driver):
    assert driver.settings
    for setting in driver.settings:
        if setting.kind == 'str' and not setting.allowed:
            with pytest.raises(ConfigError, match=rf'\.{setting.name}: 7 is not a text'):
                driver.check_settings({setting.name: 7})
            continue
        # the last is far out, the others are near what there is, or of another type
        for value in UNHEARD_OF[setting.kind][0 if setting.allowed else -1 :]:
            with pytest.raises(ConfigError) as caught:
                driver.check_settings({setting.name: value})
            text = str(caught.value)
            assert f'.{setting.name}: ' in text
            _, _, known = text.partition('; allowed: ')
            for limit in setting.allowed[:8] or setting.bounds or ('true', 'false'):
                assert (f'{limit:g}' if isinstance(limit, float) else str(limit)) in known


@every_driver
def test_typical_values_name_their_source_and_are_plausible(driver):
    assert set(driver.typical) >= {c.quantity for c in channels(driver).values()} & {
        'acceleration',
        'angular_velocity',
        'magnetic_field',
    }
    for quantity, typical in driver.typical.items():
        assert typical.source, quantity
        assert quantity in Samples.__dataclass_fields__
        for name in ('noise_density', 'bandwidth', 'range', 'resolution'):
            value = getattr(typical, name)
            assert value is None or np.all(np.asarray(value) > 0), f'{quantity}.{name}'
    acceleration = driver.typical.get('acceleration')
    if acceleration is not None and acceleration.noise_density is not None:
        # between a seismometer and a broken sensor: a wrong unit is a factor of 9.8 or 1e6
        density = np.asarray(acceleration.noise_density)
        assert np.all((density > 1e-6) & (density < 0.05))


# --- witnesses ---------------------------------------------------------------------------
@every_driver
def test_witnesses_cover_every_channel_and_range(driver):
    covered = {(w.channel.name, w.range) for w in driver.witnesses}
    for name, channel in channels(driver).items():
        ranges = channel.scaled_by.allowed if channel.scaled_by is not None else (None,)
        assert {(name, range_) for range_ in ranges} <= covered, name


@every_driver
def test_witness_bytes_mean_what_the_document_says(driver):
    for witness in driver.witnesses:
        assert witness.source
        words = Frame(witness.channel).unpack(bytes.fromhex(witness.data))[
            witness.channel.quantity
        ]
        trim = np.asarray(witness.trim) if isinstance(witness.trim, tuple) else witness.trim
        si = witness.channel.decode(words, witness.range, trim).ravel()
        half = precision(witness.channel, witness.range, si).max() * np.max(trim)
        np.testing.assert_allclose(
            si, witness.expected, rtol=1e-4, atol=half, err_msg=str(witness)
        )
        assert any(abs(value) > 10 * half for value in witness.expected), f'{witness} says nothing'


# --- round trip through the emulated chip ------------------------------------------------
class Constant:
    """A source whose samples are all alike."""

    def __init__(self, clock, values):
        self.values = values
        self.restart(clock.now_ns(), 100.0)

    def restart(self, t_ns, nominal_hz=None):
        self.nominal_hz = nominal_hz or self.nominal_hz
        self.anchor_ns, self.made = t_ns, 0

    def samples_ahead(self, t_ns):
        # what costs by the call is paid for many samples at once, as with a simulated sensor
        return self.samples_until(t_ns + round(64 * 1e9 / self.nominal_hz))

    def samples_until(self, t_ns):
        due = max(int((t_ns - self.anchor_ns) * 1e-9 * self.nominal_hz + 1e-9), self.made)
        k = np.arange(self.made + 1, due + 1)
        self.made = due
        stamps = self.anchor_ns + np.rint(k * 1e9 / self.nominal_hz).astype(np.int64)
        columns = {
            name: np.broadcast_to(value, (len(k), *np.shape(value)))
            for name, value in self.values.items()
        }
        return Samples(stamps, **columns)


def through_the_chip(name, kind, values, settings):
    """Return the last sample of each quantity that a driver delivers, and its counters."""
    clock = SimulatedClock()
    source = Constant(clock, values)
    buses = create(name, kind, source, clock)
    clock.sleep(1.0)
    driver = load(name)(buses, clock, settings)
    driver.configure()
    driver.start()
    last = {}
    for _ in range(200):
        clock.sleep(driver.poll_period_s)
        for run in driver.read():
            for quantity in values:
                if len(run) and (column := getattr(run, quantity)) is not None:
                    last[quantity] = column[-1]
        if set(last) == set(values):
            break
    assert set(last) == set(values), 'the driver does not deliver every quantity'
    return last, driver


def settings_with(driver, field, value):
    """Return the settings that put a range field to a value, {} if the user cannot."""
    mine = {name for name, declared in driver.declared(Field).items() if declared is field}
    return {s.name: value for s in driver.settings if s.name in mine and value in s.allowed}


def ranged(driver, kind=None):
    """Yield each main channel with each range a user can choose."""
    for channel in channels(driver, kind).values():
        if channel.quantity not in Samples.__dataclass_fields__:
            continue
        if channel.scaled_by is None:
            yield channel, None, {}
            continue
        for value in channel.scaled_by.allowed:
            chosen = settings_with(driver, channel.scaled_by, value)
            if chosen:
                yield channel, value, chosen


RANGES = [
    pytest.param(name, kind, channel, value, chosen, id=f'{name}-{kind}-{channel.name}-{value}')
    for name, kind in CASES
    for channel, value, chosen in ranged(load(name), kind)
]


def still(driver):
    """Return values in the middle of every quantity the driver has."""
    middle = {
        'acceleration': (0.0, 0.0, 9.80665),
        'angular_velocity': (0.0, 0.0, 0.0),
        'magnetic_field': (2e-5, 0.0, -4e-5),
        'temperature': 25.0,
        'orientation': (0.0, 0.0, 0.0, 1.0),
    }
    present = {channel.quantity for channel in channels(driver).values()}
    return {name: value for name, value in middle.items() if name in present}


@pytest.mark.parametrize(('name', 'kind', 'channel', 'range_', 'chosen'), RANGES)
@given(data=st.data())
@hypothesis_settings(max_examples=5, deadline=None)
def test_si_to_chip_to_driver_within_half_an_lsb(name, kind, channel, range_, chosen, data):
    driver = load(name)
    lsb = channel.resolution(range_)
    low, high = limits(driver, channel, range_)
    full_scale = min(-low, high, 1e3 / lsb.max())
    # three magnetic axes together may be limited: AK8963 flags a sum beyond one full scale
    reach = full_scale * lsb * (0.3 if channel.quantity == 'magnetic_field' else 0.8)
    unit = st.floats(-1.0, 1.0).map(lambda x: round(x, 6))
    if channel.quantity == 'temperature':
        si = data.draw(st.floats(-30.0, 70.0))
    elif channel.quantity == 'orientation':
        x, y, z = (data.draw(unit) for _ in range(3))
        si = np.array([x, y, z, 1.0]) / math.hypot(x, y, z, 1.0)
    else:
        si = tuple(data.draw(unit) * scale for scale in np.broadcast_to(reach, 3))
    values = {**still(driver), channel.quantity: si}
    last, made = through_the_chip(name, kind, values, chosen)
    trim = np.max(made.trims.get(channel.quantity, 1.0))
    error = np.abs(last[channel.quantity] - np.asarray(si))
    # NaN stands for an axis that the sensor does not have
    assert np.isfinite(error).sum() == channel.components
    assert np.nanmax(error / precision(channel, range_, si)) <= trim * (1 + 1e-6) + 2e-9


SATURATING = [
    case
    for case in RANGES
    if case.values[2].quantity in ('acceleration', 'angular_velocity')
    and math.isfinite(limits(load(case.values[0]), *case.values[2:4])[1])
]


@pytest.mark.parametrize(('name', 'kind', 'channel', 'range_', 'chosen'), SATURATING)
def test_beyond_full_scale_is_saturated_and_counted(name, kind, channel, range_, chosen):
    low, high = limits(load(name), channel, range_)
    lsb = channel.resolution(range_)
    values = {**still(load(name)), channel.quantity: tuple(np.broadcast_to(lsb * high * 1.5, 3))}
    last, made = through_the_chip(name, kind, values, chosen)
    counts = last[channel.quantity] / lsb
    assert np.nanmin(counts) >= high - (1 if channel.quantised else 1e-6 * high)
    # a chip may end a little beyond what counts as its end
    assert np.nanmax(counts) <= np.abs([high, low]).max() * (1 + 1e-3)
    assert made.counters['saturated'] > 0


@every_driver
def test_every_range_of_a_channel_can_be_chosen(driver):
    for name, channel in channels(driver).items():
        if channel.scaled_by is not None and channel.quantity in Samples.__dataclass_fields__:
            tested = {value for c, value, _ in ranged(driver) if c is channel}
            assert tested == set(channel.scaled_by.allowed), name


@every_bus
def test_counters_continuity_and_rates_are_there(name, kind):
    _, made = through_the_chip(name, kind, still(load(name)), {})
    assert {'bus_errors', 'saturated', 'brown_outs', *made.counter_names} <= set(made.counters)
    assert made.continuity >= 1
    assert made.rate_hz > 0
    assert 0 < made.poll_period_s <= 1.0
    assert all(rate > 0 for rate in made.rates_hz.values())
    made.stop()
    made.close()


# --- what users see ----------------------------------------------------------------------
@pytest.mark.parametrize('name', NAMES)
def test_there_is_a_valid_yaml(name):
    path = ROOT / 'config' / 'sensors' / f'{name}.yaml'
    assert path.is_file(), f'config/sensors/{name}.yaml is missing'
    sensor = load_sensor(path, settings_of=lambda driver: load(driver).settings)
    assert sensor.driver == name
    load(name).check_settings(sensor.settings)


@pytest.mark.parametrize('name', NAMES)
def test_there_is_a_row_in_the_readme(name):
    rows = [
        line
        for line in (ROOT / 'README.md').read_text(encoding='utf-8').splitlines()
        if line.startswith('|') and f'`{name}`' in line
    ]
    assert rows, f'README.md has no table row with `{name}`'


@every_driver
def test_it_is_documented(driver):
    assert inspect.getdoc(driver)
    assert inspect.getdoc(inspect.getmodule(driver))
    assert issubclass(driver, Driver)
    for register in driver.declared(Register).values():
        assert register.name.isupper(), f'{register.name} is not as the document prints it'
