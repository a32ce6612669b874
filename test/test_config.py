# SPDX-License-Identifier: Apache-2.0
"""Configuration files: read as ROS reads them, every problem told at once and by its path."""

import math
from pathlib import Path
import textwrap

from imu_bench import config
from imu_bench.bench import load_bench, load_sensor, settings_of
from imu_bench.config import Setting
from imu_bench.config.files import read_yaml
from imu_bench.config.schema import parse_quantity
from imu_bench.errors import ConfigError
import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
SENSORS = sorted((ROOT / 'config' / 'sensors').glob('*.yaml'))
BENCHES = sorted((ROOT / 'config' / 'benches').glob('*.yaml'))

MINE = """
/**:
  ros__parameters:
    driver: generic
    backend: emulated
    title: My own sensor
    rate_hz: 200.0
    simulation:
      seed: 5
      acceleration:
        noise_density: "150 µg/√Hz"
        bias: ["1 mg", "-2 mg", "0.0 mg"]
"""


def written(folder, text, name='mine.yaml'):
    path = folder / name
    path.write_text(textwrap.dedent(text), encoding='utf-8')
    return path


def problems(call, *args, **options):
    with pytest.raises(ConfigError) as caught:
        call(*args, **options)
    return str(caught.value).splitlines()


def altered(folder, **changes):
    """Write MINE with parameters changed; None takes one away."""
    document = yaml.safe_load(MINE)
    parameters = document['/**']['ros__parameters']
    for name, value in changes.items():
        if value is None:
            del parameters[name]
        else:
            parameters[name] = value
    return written(folder, yaml.safe_dump(document, allow_unicode=True))


def test_a_file_for_an_own_sensor(tmp_path):
    sensor = load_sensor(written(tmp_path, MINE))
    assert (sensor.name, sensor.namespace, sensor.frame_id) == ('mine', '/bench/mine', 'mine_link')
    assert sensor.settings == {'rate_hz': 200.0, 'title': 'My own sensor'}
    assert sensor.simulation['seed'] == 5
    assert sensor.simulation['acceleration.noise_density'][0] == pytest.approx(150e-6 * 9.80665)
    assert sensor.simulation['acceleration.bias'][1] == pytest.approx(-2e-3 * 9.80665)
    assert 'angular_velocity.axes' not in sensor.simulation
    assert sensor.address is None


@pytest.mark.parametrize('path', SENSORS, ids=lambda path: path.stem)
def test_every_shipped_sensor_is_valid_and_says_that_it_is_emulated(path):
    sensor = load_sensor(path)
    assert sensor.backend == 'emulated'
    assert sensor.frame_id == f'{path.stem}_link'


@pytest.mark.parametrize('path', BENCHES, ids=lambda path: path.stem)
def test_every_shipped_bench_is_valid(path):
    bench = load_bench(path)
    assert bench.name == path.stem
    assert set(bench.files) == {sensor.name for sensor in bench.sensors}


def test_the_machine_vibration_bench_has_the_sensors_and_rates_of_the_thesis():
    bench = load_bench(ROOT / 'config' / 'benches' / 'machine_vibration.yaml')
    rates = {sensor.name: sensor.settings['rate_hz'] for sensor in bench.sensors}
    assert rates == {
        'mti300': 400.0,
        'mpu9250': 1000.0,
        'lsm9ds1': 952.0,
        'bno055': 100.0,
        'lsm303dlhc': 1344.0,
        'mtn1100': 1003.92,  # an MCC 172 has no 1000 Hz
    }
    assert bench.analysis.window_s == 600.0
    assert bench.recorder.storage == 'mcap'


def test_the_analysis_file_is_valid():
    assert config.load_analysis(ROOT / 'config' / 'analysis.yaml').confidence == 0.95


@pytest.mark.ros
@pytest.mark.filterwarnings('ignore::DeprecationWarning:lark')
@pytest.mark.filterwarnings("ignore:module 'sre:DeprecationWarning")
@pytest.mark.parametrize('path', SENSORS, ids=lambda path: path.stem)
def test_ros_reads_the_same_from_the_same_file(path):
    rclpy = pytest.importorskip('rclpy')
    from rclpy.context import Context

    context = Context()
    rclpy.init(args=['--ros-args', '--params-file', str(path)], context=context)
    try:
        node = rclpy.create_node(
            'sensor',
            context=context,
            allow_undeclared_parameters=True,
            automatically_declare_parameters_from_overrides=True,
        )
        values = {
            name: parameter.value for name, parameter in node.get_parameters_by_prefix('').items()
        }
        node.destroy_node()
    finally:
        context.try_shutdown()
    own = load_sensor(path)
    theirs = config.sensor_from_parameters(path.stem, values, settings_of=settings_of)
    assert (theirs.settings, theirs.simulation) == (own.settings, own.simulation)
    assert (theirs.driver, theirs.stddevs) == (own.driver, own.stddevs)


def test_every_problem_is_told_at_once_with_its_path(tmp_path):
    path = altered(
        tmp_path, backend='simulated', rate_hz=200, title=None, ratehz=5.0, address=0x80
    )
    found = problems(load_sensor, path)
    where = f'{path}: ros__parameters'
    number = (
        '200 is no number with a decimal point, write 200.0: ROS parameters keep integers, texts '
        'and floats apart; allowed: 0.1 to 50000 Hz'
    )
    assert found == [
        f"{where}.ratehz: unknown; did you mean 'rate_hz'?",
        f'{where}.backend: simulated is not allowed; allowed: hardware, emulated, recorded, iio',
        f'{where}.address: 128 is not allowed; allowed: -1 to 119',
        f'{where}.rate_hz: {number}',
    ]


def test_emulation_is_never_a_default(tmp_path):
    (found,) = problems(load_sensor, altered(tmp_path, backend=None))
    assert found.endswith('backend: missing; allowed: hardware, emulated, recorded, iio')


def test_an_unknown_driver_names_what_was_meant_or_what_there_is(tmp_path):
    (found,) = problems(load_sensor, altered(tmp_path, driver='mpu925'))
    assert found.endswith("ros__parameters.driver: no driver 'mpu925'; did you mean 'mpu9250'?")
    (found,) = problems(load_sensor, altered(tmp_path, driver='xyz'))
    assert 'generic' in found


def test_a_missing_driver_names_those_there_are(tmp_path):
    (found,) = problems(load_sensor, altered(tmp_path, driver=None))
    assert 'ros__parameters.driver: missing; allowed: ' in found
    assert 'generic, ' in found
    assert 'mpu9250, ' in found


def test_driver_settings_are_held_against_the_drivers_own(tmp_path):
    path = altered(tmp_path, driver='mpu9250', rate_hz=333.0, title=None, accelerometer_range=3.0)
    found = problems(load_sensor, path)
    assert len(found) == 2
    assert (
        'ros__parameters.accelerometer_range: 3 is not allowed; allowed: 2, 4, 8, 16 g' in found[1]
    )


@pytest.mark.parametrize(
    ('value', 'expected'),
    [
        ('150', 'measures number'),
        ('150 µg', 'measures acceleration'),
        ('abc µg/√Hz', 'is not a number and a unit'),
        ('150 furlong', 'unknown unit'),
        ('-1 µg/√Hz', 'allowed: 0 m/s²/√Hz or more'),
        ('nan µg/√Hz', 'is not finite'),
        (0.5, 'has no unit'),
        (['1 µg/√Hz', '2 µg/√Hz'], 'has 2 values'),
    ],
)
def test_a_quantity_without_the_right_unit_is_refused(tmp_path, value, expected):
    path = altered(tmp_path, simulation={'acceleration': {'noise_density': value}})
    (found,) = problems(load_sensor, path)
    assert 'simulation.acceleration.noise_density' in found
    assert expected in found


def test_ascii_spellings_of_units_are_understood():
    assert parse_quantity('150 ug/sqrt(Hz)', 'm/s²/√Hz') == pytest.approx(1.4709975e-3)
    assert parse_quantity('100 ppm', '1') == pytest.approx(1e-4)


def test_hardware_needs_a_bus(tmp_path):
    path = altered(tmp_path, driver='mpu9250', title=None, rate_hz=1000.0, backend='hardware')
    (found,) = problems(load_sensor, path)
    assert "bus: missing; a hardware sensor needs one, such as 'i2c-1'" in found


def test_parameters_of_ros_itself_are_left_to_ros(tmp_path):
    path = altered(
        tmp_path, use_sim_time=False, qos_overrides={'/bench/mine/imu/data_raw': {'depth': 5}}
    )
    assert load_sensor(path).driver == 'generic'


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('', 'holds no mapping'),
        ('a: 1\nb: 2\n', "holds 'a', 'b' at the top"),
        ('/**:\n  parameters: {}\n', "below it 'ros__parameters:'"),
        ('/**:\n  ros__parameters: 5\n', 'holds no settings'),
        ('/**:\n  ros__parameters: {a: 1\n', 'line'),
        ('/**:\n  ros__parameters:\n    driver: a\n    driver: b\n', "'driver' is given twice"),
        ('? [1, 2]\n: 3\n', 'not YAML'),
    ],
)
def test_files_that_are_no_parameter_files_are_refused_with_the_place(tmp_path, text, expected):
    path = written(tmp_path, text)
    (found,) = problems(load_sensor, path)
    assert found.startswith(str(path))
    assert expected in found


def test_a_missing_file_and_one_that_is_no_text_are_named(tmp_path):
    (found,) = problems(load_sensor, tmp_path / 'nothing.yaml')
    assert found == f'{tmp_path / "nothing.yaml"}: cannot be read: No such file or directory'
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(b'\xff\xfe\x00\x80')
    (found,) = problems(load_sensor, binary)
    assert 'not UTF-8' in found


BENCH = """
name: two
sensors:
  - file: mine.yaml
  - file: mine.yaml
    name: other
    overrides: {rate_hz: 50.0, simulation: {seed: 9}}
"""


def test_a_bench_takes_a_file_twice_under_two_names(tmp_path):
    written(tmp_path, MINE)
    bench = load_bench(written(tmp_path, BENCH, 'bench.yaml'))
    first, second = bench.sensors
    assert (first.name, second.name) == ('mine', 'other')
    assert (first.settings['rate_hz'], second.settings['rate_hz']) == (200.0, 50.0)
    assert (first.simulation['seed'], second.simulation['seed']) == (5, 9)
    assert bench.overrides['other'] == {'rate_hz': 50.0, 'simulation.seed': 9}
    assert bench.files['other'] == tmp_path / 'mine.yaml'


@pytest.mark.parametrize('file', ['mpu9250', 'config/sensors/mpu9250.yaml'])
def test_a_bench_anywhere_names_a_sensor_of_the_package_unless_it_has_its_own(tmp_path, file):
    path = written(tmp_path, f'{{name: one, sensors: [{{file: {file}}}]}}', 'bench.yaml')
    shipped = Path(__file__).resolve().parent.parent / 'config' / 'sensors' / 'mpu9250.yaml'
    assert load_bench(path).files['mpu9250'].samefile(shipped)
    own = tmp_path / file
    own.parent.mkdir(parents=True, exist_ok=True)
    written(own.parent, MINE, own.name)
    assert load_bench(path).files['mpu9250'] == own


@pytest.mark.parametrize(
    ('file', 'said'),
    [
        ('mpu9205', "no sensor 'mpu9205'; did you mean 'mpu9250'?"),
        ('config/sensors/none.yaml', "no sensor 'none'; known are adxl355, "),
        ('mpu9250.yaml', 'mpu9250.yaml: no such file; those of the package are, without .yaml: '),
    ],
)
def test_a_sensor_that_is_not_there_is_answered_with_those_that_are(tmp_path, file, said):
    path = written(tmp_path, f'{{name: one, sensors: [{{file: {file}}}]}}', 'bench.yaml')
    (found,) = problems(load_bench, path)
    assert found.startswith(f'{path}: sensors[0].file: ')
    assert said in found


def test_a_bench_anywhere_takes_the_tests_of_one_of_the_package(tmp_path):
    text = '{name: one, sensors: [{file: mtn1100}], tests: machine_vibration}'
    assert load_bench(written(tmp_path, text, 'bench.yaml')).test('lift').scenarios
    text = text.replace('machine_vibration', 'gone.yaml')
    (found,) = problems(load_bench, written(tmp_path, text, 'bench.yaml'))
    assert found.startswith(f'{tmp_path / "bench.yaml"}: tests: ')


def test_every_problem_of_a_bench_and_its_sensors_at_once(tmp_path):
    written(tmp_path, MINE)
    path = written(
        tmp_path,
        """
        title: no name
        analysis: {window_s: 0.5}
        recorder: {storage: bag}
        sensors:
          - file: mine.yaml
          - file: mine.yaml
          - file: mine.yaml
            name: third
            overrides: {rate_hz: 1, sede: 4}
          - fil: other.yaml
          - just text
        """,
        'bench.yaml',
    )
    found = '\n'.join(problems(load_bench, path))
    for expected in (
        'bench.name: missing',
        'analysis.window_s: 0.5 is not allowed; allowed: 1 to 86400 s',
        'recorder.storage: bag is not allowed; allowed: mcap, sqlite3',
        "sensors[1].name: 'mine' is there already",
        'mine.yaml: ros__parameters.rate_hz: 1 is no number',
        'mine.yaml: ros__parameters.sede: unknown',
        "sensors[3].fil: unknown; did you mean 'file'?",
        'sensors[3].file: missing',
        "sensors[4]: 'just text' is no entry",
    ):
        assert expected in found


def test_a_bench_without_sensors_says_what_to_write(tmp_path):
    (found,) = problems(load_bench, written(tmp_path, 'name: none\n'))
    assert "sensors: missing; give a list of entries like '- file: x.yaml'" in found


def test_the_constraint_of_a_setting_is_written_out():
    many = Setting('a', 1.0, '', allowed=tuple(map(float, range(1, 101))), unit='Hz')
    assert many.constraint == '1, 2, 3, 4, 5, 6, 7, 8, … 100 Hz'
    with pytest.raises(ConfigError, match=r'60\.5 is not allowed; .* 100 Hz; nearest 60 and 61$'):
        many.check(60.5)
    with pytest.raises(ConfigError, match=r'nearest 100$'):
        many.check(1e6)
    assert Setting('a', 1.0, '', allowed=(1.0, 2.5), unit='g').constraint == '1, 2.5 g'
    assert Setting('a', 1, '', bounds=(0, math.inf)).constraint == '0 or more'
    assert Setting('a', True, '').constraint == 'true or false'


@pytest.mark.parametrize(
    ('setting', 'value'),
    [
        (Setting('a', True, ''), 1),
        (Setting('a', 1, ''), True),
        (Setting('a', 1, ''), 1.0),
        (Setting('a', 1.0, ''), math.nan),
        (Setting('a', '', ''), 5),
        (Setting('a', (), ''), ['x', 5]),
    ],
)
def test_a_value_of_another_type_is_never_converted(setting, value):
    with pytest.raises(ConfigError, match='allowed'):
        setting.check(value)


def _laughs(levels):
    lines = ['a0: &a0 [x, x, x, x, x, x, x, x, x, x]']
    lines += [f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 10)}]' for n in range(1, levels)]
    return '\n'.join(lines)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (_laughs(9), 'more than 100000 entries'),
        ('a: &a [*a]', 'contains itself'),
        ('a: ' + '[' * 100 + ']' * 100, 'nested more than 40 levels'),
        ('a: ' + '[' * 20_000, 'nested more than 40 levels'),
        ('\n'.join([f'a{n}: &a{n} [*a{n - 1}]' for n in range(1, 60)]).replace('*a0', 'x'),
         'nested more than 40 levels'),
        ('a: ' + '7' * 5000, 'not YAML'),
        ('a: 0x' + 'f' * 5000, 'a number of more than 100 digits'),
        ('a: 2001-13-45', 'not YAML'),
        ('a: ' + 'x' * 300_000, 'larger than 256 KiB'),
        (f'? {"x" * 900}\n: 1\n? {"x" * 900}\n: 2', 'is given twice'),
    ],
)  # fmt: skip
def test_yaml_that_grows_is_refused_in_one_short_line(tmp_path, text, words):
    [line] = problems(read_yaml, written(tmp_path, text))
    assert words in line
    assert len(line) < 1500


def test_yaml_may_use_aliases(tmp_path):
    path = written(tmp_path, 'shared: &s {rate: 1.0}\none: *s\ntwo: {<<: *s, bus: a}')
    assert read_yaml(path)['two'] == {'rate': 1.0, 'bus': 'a'}
