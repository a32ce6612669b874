# SPDX-License-Identifier: Apache-2.0
"""A minute at rest: every row is good on a good bench, and fails where one constant is wrong."""

from dataclasses import replace
from types import SimpleNamespace

from imu_bench import bench, drivers
from imu_bench.config import BenchConfig, sensor_from_parameters
from imu_bench.config.location import config_file
from imu_bench.doctor import minute
from imu_bench.doctor.resting import as_json, check, OK, UNKNOWN, WRONG
from imu_bench.registers import Frame
from imu_bench.simulation.clock import SimulatedClock
import pytest

SECONDS = 10.0


def sensor(driver, **settings):
    given = {'driver': driver, 'backend': 'emulated', 'simulation.seed': 3, **settings}
    return sensor_from_parameters('one', given, settings_of=bench.settings_of)


def checked(one, up='z'):
    return check(BenchConfig('rest', sensors=(one,), up={'one': up}), SECONDS)


def failing(rows):
    return {row.what.partition(',')[0] for row in rows if row.verdict == WRONG}


@pytest.fixture
def driven_by(monkeypatch):
    """Let a driver with something wrong run on the right chip."""

    def use(made):
        load = drivers.load

        def loaded(name):
            return made if name == made.name else load(name)

        monkeypatch.setattr(bench, 'drivers', SimpleNamespace(load=loaded, names=drivers.names))

    return use


def scaled(channel, *factors):
    """Return a channel whose scale is wrong by a factor, or one for each axis."""
    factors = factors * 3 if len(factors) == 1 else factors
    table = channel.si_per_lsb
    if not isinstance(table, dict):
        return replace(channel, si_per_lsb=tuple(table * f for f in factors))
    return replace(
        channel, si_per_lsb={key: tuple(si * f for f in factors) for key, si in table.items()}
    )


IIM = {'rate_hz': 100.0}
Iim42652 = drivers.load('iim42652')
Lsm303dlhc = drivers.load('lsm303dlhc')
Lsm9ds1 = drivers.load('lsm9ds1')
Mti300 = drivers.load('mti300')


@pytest.mark.slow
@pytest.mark.parametrize('name', ['all_eight', 'mast_inclination', 'vehicle_vibration'])
def test_the_benches_of_the_documents_are_well(name):
    rows = check(bench.load_bench(config_file(f'benches/{name}.yaml')), SECONDS)
    assert failing(rows) == set()
    found = {row.what.partition(',')[0] for row in rows if row.verdict == OK}
    assert {'rate', 'samples lost', 'gravity', 'values', 'mounting', 'temperature'} <= found


@pytest.mark.slow
def test_every_row_is_there_and_good():
    rows = checked(sensor('iim42652', **IIM))
    assert [row.what for row in rows if row.verdict != OK] == []
    assert {row.what.partition(',')[0] for row in rows} == {
        'rate', 'samples lost', 'gravity', 'noise', 'values', 'temperature',
        'FIFO less registers', 'mounting',
    }  # fmt: skip
    assert {row.what for row in checked(sensor('mti300'))} >= {'magnetic field'}


def test_a_wrong_scale_of_the_accelerometer_is_not_gravity(driven_by):
    class Wrong(Iim42652):
        acceleration = scaled(Iim42652.acceleration, 1.05)

    driven_by(Wrong)
    assert 'gravity' in failing(checked(sensor('iim42652', **IIM)))


def test_a_wrong_scale_of_the_gyroscope_is_not_its_noise(driven_by):
    class Wrong(Iim42652):
        angular_velocity = scaled(Iim42652.angular_velocity, 4.0)

    driven_by(Wrong)
    # at ±2000 °/s a step is more than the noise
    rows = checked(sensor('iim42652', **IIM, gyroscope_range=250.0))
    assert failing(rows) == {'noise'}
    (row,) = [row for row in rows if row.verdict == WRONG]
    assert row.what.startswith('noise, angular velocity')
    assert row.measured.unit == 'rad/s/√Hz'


@pytest.mark.slow
def test_another_rate_than_the_one_set(driven_by):
    class Wrong(Lsm303dlhc):
        def assignments(self):
            found = super().assignments()
            return {field: 200.0 if value == 100.0 else value for field, value in found.items()}

    driven_by(Wrong)
    assert 'rate' in failing(checked(sensor('lsm303dlhc', rate_hz=100.0)))


def test_samples_that_do_not_come():
    lossy = sensor('iim42652', **IIM, **{'simulation.faults': ['unplugged 8 2']})
    assert failing(checked(lossy)) == {'samples lost'}
    gone = sensor('iim42652', **IIM, **{'simulation.faults': ['unplugged 0 100']})
    (row,) = checked(gone)
    assert (row.what, row.verdict) == ('samples', WRONG)


def test_an_axis_that_is_taken_for_another(driven_by):
    class Wrong(Iim42652):
        acceleration = replace(Iim42652.acceleration, axes=((0, 0, 1), (0, 1, 0), (-1, 0, 0)))

    driven_by(Wrong)
    rows = checked(sensor('iim42652', **IIM))
    assert failing(rows) == {'mounting'}
    assert [round(row.measured.value) for row in rows if row.what == 'mounting'] == [
        pytest.approx(90, abs=3)
    ]


def test_a_sensor_that_is_mounted_otherwise_than_the_bench_says():
    tilted = sensor('iim42652', **IIM, **{'simulation.roll': '90 °'})
    assert failing(checked(tilted)) == {'mounting'}
    assert failing(checked(tilted, 'y')) == set()
    (row,) = [row for row in checked(tilted, '') if row.what == 'mounting']
    assert row.verdict == UNKNOWN
    assert 'up: y' in row.advice


def test_an_axis_that_is_stuck_and_one_that_is_read_twice(driven_by):
    class Stuck(Iim42652):
        angular_velocity = scaled(Iim42652.angular_velocity, 0.0, 1.0, 1.0)

    driven_by(Stuck)
    assert 'values' in failing(checked(sensor('iim42652', **IIM)))

    class Twice(Iim42652):
        def decode(self, words, *channels):
            found = super().decode(words, *channels)
            if 'angular_velocity' in found:
                found['angular_velocity'][:, 1] = found['angular_velocity'][:, 0]
            return found

    driven_by(Twice)
    rows = checked(sensor('iim42652', **IIM))
    assert [row.advice for row in rows if row.verdict == WRONG] == ['x and y are the same']


@pytest.mark.slow
def test_a_wrong_unit_of_the_magnetometer(driven_by):
    class Wrong(Mti300):
        magnetic_field = scaled(Mti300.magnetic_field, 100.0)

    driven_by(Wrong)
    assert failing(checked(sensor('mti300'))) == {'magnetic field'}


def test_a_wrong_zero_of_the_thermometer(driven_by):
    class Wrong(Iim42652):
        temperature = replace(Iim42652.temperature, offset=-25.0)

    driven_by(Wrong)
    assert failing(checked(sensor('iim42652', **IIM))) == {'temperature'}


@pytest.mark.slow
def test_a_fifo_whose_slots_are_taken_in_the_wrong_order(driven_by):
    class Wrong(Lsm9ds1):
        def __init__(self, *given):
            super().__init__(*given)
            self.fifo._frame = Frame(self.acceleration, self.angular_velocity)

    driven_by(Wrong)
    one = sensor('lsm9ds1', rate_hz=119.0, accelerometer_bandwidth=50.0)
    assert 'FIFO less registers' in failing(checked(one))


def test_rows_are_json_with_estimates():
    rows = checked(sensor('iim42652', **IIM))
    document = as_json('rest', rows)
    assert (document['schema'], document['ok']) == ('imu_bench.doctor.check/1', True)
    gravity = next(row for row in document['rows'] if row['what'] == 'gravity')
    assert gravity['measured']['low'] <= gravity['measured']['value']
    assert gravity['measured']['unit'] == 'm/s²'


def test_what_is_not_there_is_a_row_and_the_others_stand_still_in_real_time(monkeypatch):
    monkeypatch.setattr(minute, 'SETTLING_S', 1.0)
    there = sensor('iim42652', **IIM)
    gone = sensor_from_parameters(
        'gone', {'driver': 'mpu9250', 'backend': 'hardware', 'bus': 'i2c-77'},
        settings_of=bench.settings_of,
    )  # fmt: skip
    rows = check(BenchConfig('rest', sensors=(there, gone), up={'one': 'z'}), 3.0)
    (row,) = [row for row in rows if row.sensor == 'gone']
    assert (row.what, row.verdict) == ('samples', WRONG)
    assert 'i2c-77' in row.advice
    # on a machine that is busy with other things samples may be lost
    found = {row.what.partition(',')[0]: row.verdict for row in rows if row.sensor == 'one'}
    for what in ('rate', 'gravity', 'mounting', 'temperature', 'FIFO less registers'):
        assert found[what] == OK, what


def test_a_recording_is_played_and_not_checked(tmp_path):
    wire = tmp_path / 'one.wire'
    written = replace(sensor('iim42652', **IIM), wire_recording=str(wire))
    acquisition = bench.build(written, SimulatedClock())
    acquisition.prepare()
    acquisition.close()
    played = replace(written, backend='recorded')
    (row,) = checked(played)
    assert (row.what, row.verdict) == ('samples', UNKNOWN)
