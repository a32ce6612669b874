# SPDX-License-Identifier: Apache-2.0
"""Where sensors are: what a bench may say, and that it is in bags and in a URDF."""

from xml.etree import ElementTree

from imu_bench.bench import hardware_id, load_bench
from imu_bench.config import load_sensor, SensorConfig
from imu_bench.errors import ConfigError
from imu_bench.nodes.bench_nodes import sensors_with_files
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

SENSOR = """
/**:
  ros__parameters:
    driver: generic
    backend: emulated
    rate_hz: 50.0
    simulation:
      acceleration: {noise_density: "100 µg/√Hz"}
"""
PLACES = """
name: mine
sensors:
  - file: one.yaml
    name: left
    up: z
    mounting: {xyz: ["120 mm", "-35 mm", "0.01 m"], rpy: ["0 °", "0 °", "90 °"]}
  - file: one.yaml
    name: right
    up: -z
    mounting: {parent: plate, rpy: ["180 °", "0 °", "0 °"]}
  - file: one.yaml
    name: loose
"""


@pytest.fixture
def bench_file(tmp_path):
    (tmp_path / 'one.yaml').write_text(SENSOR, encoding='utf-8')

    def write(text=PLACES):
        path = tmp_path / 'bench.yaml'
        path.write_text(text, encoding='utf-8')
        return path

    return write


def test_a_bench_says_where_its_sensors_are(bench_file):
    left, right, loose = load_bench(bench_file()).sensors
    assert left.mounting.parent == 'base_link'
    assert left.mounting.xyz == pytest.approx((0.12, -0.035, 0.01))
    assert left.mounting.rpy == pytest.approx((0.0, 0.0, 1.5707963267948966))
    assert (right.mounting.parent, right.mounting.xyz) == ('plate', (0.0, 0.0, 0.0))
    assert loose.mounting is None


def test_twins_of_one_file_have_frames_and_hardware_ids_of_their_own(bench_file):
    sensors = load_bench(bench_file()).sensors
    assert [one.frame_id for one in sensors] == ['left_link', 'right_link', 'loose_link']
    assert len({hardware_id(one) for one in sensors}) == 3


def test_a_wire_tells_who_is_on_it():
    left = SensorConfig('left', 'mpu9250', 'hardware', 'i2c-1', address=0x69)
    assert hardware_id(left) == 'hardware mpu9250 i2c-1 0x69'


def test_the_nodes_are_told(bench_file, tmp_path):
    bench = load_bench(bench_file())
    for sensor, word in zip(
        bench.sensors, sensors_with_files(bench, bench.sensors, tmp_path, {}), strict=True
    ):
        name, _, files = word.partition('=')
        *_, own = files.split(',')
        if sensor.mounting is None:
            assert own.endswith('one.yaml')
            continue
        text = (tmp_path / f'{name}.yaml').read_text(encoding='utf-8')
        whole = tmp_path / f'whole_{name}.yaml'
        whole.write_text(text + SENSOR.partition('ros__parameters:\n')[2], encoding='utf-8')
        assert load_sensor(whole).mounting == sensor.mounting


@pytest.mark.parametrize(
    ('entry', 'said'),
    [
        ('mounting: 3', 'sensors[0].mounting: 3 is no mapping of settings'),
        ('mounting: {xyz: ["1 m"]}', 'mounting.xyz: one value; give three'),
        ('mounting: {xyz: [0.1, 0.0, 0.0]}', 'mounting.xyz: 0.1 has no unit'),
        ('mounting: {rpy: ["1 m", "0 °", "0 °"]}', 'mounting.rpy'),
        ('mounting: {parent: /base, xyz: ["0 m", "0 m", "0 m"]}', "parent: '/base' is no frame"),
        ('mounting: {place: here}', 'mounting.place'),
        (
            'up: x\n    mounting: {rpy: ["0 °", "0 °", "90 °"]}',
            'left: mounting.rpy does not turn x up, but the bench says up: x',
        ),
    ],
)
def test_what_makes_no_sense_is_said(bench_file, entry, said):
    text = f'name: mine\nsensors:\n  - file: one.yaml\n    name: left\n    {entry}\n'
    with pytest.raises(ConfigError) as raised:
        load_bench(bench_file(text))
    assert said in str(raised.value)
    assert '\n' not in str(raised.value)


def test_two_places_of_one_frame_are_refused(bench_file):
    entry = '  - {{file: one.yaml, name: {}, overrides: {{frame_id: imu}}, mounting: {}}}\n'
    zero = '{xyz: ["0 m", "0 m", "0 m"]}'
    text = 'name: mine\nsensors:\n' + entry.format('a', zero) + entry.format('b', zero)
    with pytest.raises(ConfigError, match=r"b: frame_id 'imu' is that of a"):
        load_bench(bench_file(text))
    load_bench(bench_file(text.replace(f', mounting: {zero}', '', 1)))


def transforms(bag):
    with AnyReader([bag]) as reader:
        (topic,) = [each for each in reader.connections if each.topic == '/tf_static']
        (qos,) = topic.ext.offered_qos_profiles
        assert (topic.msgtype, qos.durability.name) == (
            'tf2_msgs/msg/TFMessage', 'TRANSIENT_LOCAL',
        )  # fmt: skip
        return {
            each.child_frame_id: (each.header.frame_id, each.transform)
            for _, _, blob in reader.messages([topic])
            for each in reader.deserialize(blob, topic.msgtype).transforms
        }


def held(bag):
    found = transforms(bag)
    assert set(found) == {'left_link', 'right_link'}
    assert [parent for parent, _ in found.values()] == ['base_link', 'plate']
    _, left = found['left_link']
    assert (left.translation.x, left.translation.y) == pytest.approx((0.12, -0.035))
    assert (left.rotation.z, left.rotation.w) == pytest.approx((0.5**0.5, 0.5**0.5))


@pytest.mark.slow
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_simulated_bags_say_it_and_are_analysed(bench_file, run_cli, tmp_path, storage):
    bag = tmp_path / 'bag'
    run_cli('simulate', bench_file(), '--duration', '20s', '-o', bag, '--storage', storage)
    held(bag)
    assert 'left' in run_cli('analyze', bag)


@pytest.mark.slow
def test_recordings_without_ros_say_it(bench_file, run_cli, tmp_path):
    bag = tmp_path / 'bag'
    run_cli('record', bench_file(), '--direct', '--duration', '2s', '-o', bag)
    held(bag)


def test_a_urdf_says_the_same(bench_file, run_cli, tmp_path):
    path = bench_file(PLACES.replace('parent: plate', 'parent: left_link'))
    robot = ElementTree.fromstring(run_cli('export', path, '--to', 'urdf').encode())
    assert [link.get('name') for link in robot.iter('link')] == [
        'base_link', 'left_link', 'right_link',
    ]  # fmt: skip
    joints = {joint.find('child').get('link'): joint for joint in robot.iter('joint')}
    for sensor in load_bench(path).sensors[:2]:
        joint = joints[sensor.frame_id]
        assert joint.get('type') == 'fixed'
        assert joint.find('parent').get('link') == sensor.mounting.parent
        origin = joint.find('origin')
        xyz, rpy = ([float(v) for v in origin.get(name).split()] for name in ('xyz', 'rpy'))
        assert xyz == pytest.approx(sensor.mounting.xyz)
        turned = Rotation.from_euler('xyz', rpy)
        assert turned.approx_equal(Rotation.from_quat(sensor.mounting.quaternion), atol=1e-8)
    output = tmp_path / 'mine.urdf'
    assert run_cli('export', path, '--to', 'urdf', '-o', output) == f'wrote {output}\n'


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        ('', '', 'mounting.parent leads to base_link and plate; a URDF has one root'),
        (
            'parent: plate',
            'parent: right_link',
            'goes round in a circle: right_link to right_link',
        ),
        ('mounting:', '# ', 'no sensor has a place'),
    ],
)
def test_what_is_no_tree_is_refused(bench_file, capsys, old, new, said):
    from imu_bench.cli.main import main

    assert main(['export', str(bench_file(PLACES.replace(old, new))), '--to', 'urdf']) == 1
    assert said in capsys.readouterr().err


@pytest.fixture
def run_cli(capsys):
    """Run a verb that has to succeed, and return what it prints."""
    from imu_bench.cli.main import main

    def run(*words):
        code = main([str(word) for word in words])
        shown = capsys.readouterr()
        assert code == 0, shown.out + shown.err
        return shown.out

    return run
