# SPDX-License-Identifier: Apache-2.0
"""Whom a bench can be reached by: a visitor on another host, other shells of this one."""

from contextlib import contextmanager
from importlib import util
import json
from pathlib import Path
import re
import subprocess
import sys

from imu_bench.bags import metadata
from imu_bench.errors import ConfigError
from imu_bench.nodes import network
import pytest
import yaml

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SPEC = util.spec_from_file_location('namespaces', Path(__file__).with_name('namespaces.py'))
namespaces = util.module_from_spec(SPEC)
SPEC.loader.exec_module(namespaces)
HOME, plain_environment = namespaces.HOME, namespaces.plain_environment

VISITOR = Path(__file__).with_name('visitor.py')
LOOPBACK = '0100007F'  # 127.0.0.1 as /proc/net has it
CONTROL = '/control'
SPACE = '/bench/left'
TOPIC = f'{SPACE}/imu/data_raw'
OF_CYCLONE = (
    f'<CycloneDDS><Domain><Discovery><Peers><Peer address="{HOME}"/></Peers></Discovery>'
    '</Domain></CycloneDDS>'
)


LED_OUT = {
    'ROS_STATIC_PEERS': namespaces.AWAY,
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
    'ROS_DISCOVERY_SERVER': f'{namespaces.AWAY}:11811',
    'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
}
"""Variables of a shell that is made to reach other machines."""

OPEN = '/bench/open/imu/data_raw'
UP = r'^\d+:\d\d:\d\d'
"""Lines of a recording that has begun say how long it has run."""


@pytest.fixture(scope='module')
def permitted():
    """Give two hosts, or why namespaces are not permitted here."""
    try:
        made = namespaces.Hosts()
    except (OSError, subprocess.CalledProcessError) as error:
        yield str(getattr(error, 'stderr', '') or error)
        return
    yield made
    made.close()


@pytest.fixture(scope='module')
def hosts(permitted):
    """Give two hosts; where that is not permitted the table of sockets has to do."""
    if isinstance(permitted, str):
        pytest.skip(f'namespaces are not permitted here ({permitted}); the sockets are checked')
    return permitted


@pytest.fixture(scope='module')
def control(hosts):
    """Publish, on the bench's host, what every visitor sees."""
    command = hosts.at_home(sys.executable, VISITOR, 'publish', 'rmw', CONTROL)
    with running(command, 'up') as process:
        yield process
        process.stdin.close()


@pytest.fixture(scope='class', params=['record', 'demo'])
def alone(request, permitted, tmp_path_factory):
    """Give a bench that runs as it does by itself, the demo in a shell that leads out."""
    folder = tmp_path_factory.mktemp(request.param)
    command = verb(request.param, bench(folder), '-o', folder / 'out', '--duration', '600')
    here = command if isinstance(permitted, str) else permitted.at_home(*command)
    shell = LED_OUT if request.param == 'demo' else {}
    with running(here, UP, IMU_BENCH_LINE_EVERY_S='0.5', **shell) as process:
        yield process
        code, output = ended(process)
    assert code == 0, output
    assert ', this machine only\n' in process.said[0]
    bag = folder / 'out' / ('bag' if request.param == 'demo' else '')
    assert metadata.read(bag / 'metadata.yaml').custom['network'] == 'this machine only'


@contextmanager
def running(command, until, **environment):
    """Run a command; yield the process when a line of its output matches."""
    with subprocess.Popen(
        list(map(str, command)), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, env=plain_environment(**environment),
    ) as process:  # fmt: skip
        process.said = []
        try:
            for line in process.stdout:
                process.said.append(line)
                if re.search(until, line):
                    break
            else:
                raise AssertionError(f'{until!r} does not match {"".join(process.said)}')
            yield process
        finally:
            if process.poll() is None:
                process.terminate()


def bench(folder):
    """Write the file of a bench of one sensor."""
    simulation = {'acceleration': {'noise_density': '60 µg/√Hz'}}
    parameters = {'driver': 'generic', 'backend': 'emulated', 'rate_hz': 100.0}
    document = {'/**': {'ros__parameters': {**parameters, 'simulation': simulation}}}
    sensor, path = folder / 'left.yaml', folder / 'bench.yaml'
    sensor.write_text(yaml.safe_dump(document), encoding='utf-8')
    bench = {'name': 'small', 'sensors': [{'file': str(sensor)}]}
    path.write_text(yaml.safe_dump(bench), encoding='utf-8')
    return path


def verb(*arguments):
    return [sys.executable, '-m', 'imu_bench.cli.main', *arguments]


def ended(process):
    """Ask it to end; return exit code and everything it said."""
    process.terminate()
    output, _ = process.communicate()
    return process.returncode, ''.join(process.said) + output


def visit(hosts, kinds=('rmw', 'cyclone'), *more):
    """Return the topics of benches that visitors see, by kind; each sees the control."""
    environment = plain_environment(ROS_STATIC_PEERS=HOME, CYCLONEDDS_URI=OF_CYCLONE)
    visitors = {
        kind: subprocess.Popen(
            hosts.away(sys.executable, VISITOR, kind, CONTROL, *more),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
        )
        for kind in kinds
    }  # fmt: skip
    seen = {}
    for kind, visitor in visitors.items():
        found, problems = visitor.communicate()
        assert visitor.returncode == 0, problems
        assert CONTROL in json.loads(found)
        seen[kind] = [name for name in json.loads(found) if name.startswith('/bench')]
    return seen


def family(pid):
    """Return a process and all that descend from it."""
    children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    return [pid, *(each for child in children for each in family(int(child)))]


class TestAlone:
    """A bench as it runs by itself, record and demo; each ends after the last test of it."""

    def test_every_socket_is_on_loopback(self, alone):
        assert namespaces.sockets(family(alone.pid)) == {LOOPBACK}

    def test_other_shells_of_the_machine_see_it_with_what_is_printed(self, alone, permitted):
        domain = plain_environment()['ROS_DOMAIN_ID']
        assert f'other shells see it with: export ROS_DOMAIN_ID={domain}\n' in alone.said
        look = [sys.executable, VISITOR, 'rmw', '', TOPIC]
        look = look if isinstance(permitted, str) else permitted.at_home(*look)
        for environment in (plain_environment(), plain_environment(ROS_LOCALHOST_ONLY='1')):
            seen = subprocess.run(look, env=environment, capture_output=True, text=True)
            assert TOPIC in json.loads(seen.stdout)

    def test_a_visitor_sees_nothing(self, hosts, control, alone):
        assert visit(hosts) == {'rmw': [], 'cyclone': []}
        assert alone.poll() is None


def test_a_visitor_sees_nothing_of_a_bench_on_cyclone(hosts, control):
    one, other = (
        hosts.at_home(sys.executable, VISITOR, 'publish', 'cyclone', topic)
        for topic in (TOPIC, OPEN)
    )
    setting = network.variables(network.ALONE, {'RMW_IMPLEMENTATION': network.CYCLONE})
    with (
        running(one, 'up', CYCLONEDDS_URI=setting['CYCLONEDDS_URI']) as kept,
        running(other, 'up') as reached,
    ):
        # and would see it otherwise
        assert visit(hosts, ('rmw', 'cyclone'), OPEN) == {'rmw': [OPEN], 'cyclone': [OPEN]}
        for process in (kept, reached):
            process.stdin.close()


def assert_open(process, bag, words):
    assert process.said[0].endswith(f', {words}\n')
    assert metadata.read(bag / 'metadata.yaml').custom == {'network': words, 'bench': SPACE}


def test_a_visitor_sees_a_bench_that_is_opened_on_one_interface(hosts, control, tmp_path):
    command = verb('demo', bench(tmp_path), '-o', tmp_path / 'out', '--network', 'v0')
    command += ['--duration', '600']
    with running(hosts.at_home(*command), UP, IMU_BENCH_LINE_EVERY_S='0.5') as process:
        assert TOPIC in visit(hosts, ('rmw',), TOPIC)['rmw']
        code, output = ended(process)
    assert code == 0, output
    assert_open(process, tmp_path / 'out' / 'bag', 'open to the network on v0')


def test_what_a_visitor_publishes_in_a_sensors_name_is_named_everywhere(hosts, control, tmp_path):
    bag = tmp_path / 'bag'
    command = verb('record', bench(tmp_path), '-o', bag, '--network', 'all')
    line = f'several publish {TOPIC}: /bench/left/sensor_node, /visitor'
    with running(hosts.at_home(*command), UP, IMU_BENCH_LINE_EVERY_S='0.5') as process:
        # until /diagnostics names him, with this line, and counts his messages
        assert TOPIC in visit(hosts, ('rmw',), TOPIC, line)['rmw']
        for said in process.stdout:
            process.said.append(said)
            if line in said:
                break
        code, output = ended(process)
    assert_open(process, bag, 'open to the network on all interfaces')
    assert f' WARNING: {line}\n' in output
    assert (code, line in output.splitlines()[-1]) == (1, True), output
    kept = re.search(r'left: .* kept its rate .*, (\d+) of somebody else kept out', output)
    assert int(kept[1]) > 0, output  # and none is in the bag
    report = tmp_path / 'results.json'
    analyze = verb('analyze', bag, '--json', report)
    assert subprocess.run(analyze, capture_output=True).returncode == 0
    recordings = json.loads(report.read_text())['recordings']
    (result,) = [each for each in recordings if each['topic'] == TOPIC]
    found = {each['code']: each['severity'] for each in result['health']['findings']}
    assert found['several_publishers'] == 'severe'
    # the noise is that of the sensor, 60 µg/√Hz; one message of 1e6 m/s² would be 5e4 m/s²/√Hz
    noise = result['axes']['linear_acceleration.x']['coefficients']['N']['value']
    assert noise == pytest.approx(60e-6 * 9.80665, rel=0.5)


def test_what_cannot_be_chosen_is_refused():
    with pytest.raises(
        ConfigError, match=r'--network eth9: there is no such interface; there are'
    ):
        network.variables('eth9', {})
    with pytest.raises(ConfigError, match=r'RMW_IMPLEMENTATION=rmw_zenoh_cpp: .* not known here'):
        network.variables(network.ALONE, {'RMW_IMPLEMENTATION': 'rmw_zenoh_cpp'})
