# SPDX-License-Identifier: Apache-2.0
"""
The policies for SROS 2, held against the graph that a running bench shows.

The middleware of the wheels is built without security, so nothing can be refused here: what is
checked is that the policies allow what the nodes use, nothing missing and nothing too much.
`IMU_BENCH_WRITE_GOLDEN=1 pytest test/nodes/test_security.py` writes them anew, in the format of
`ros2 security generate_policy` (sros2, sros2/verb/generate_policy.py, commit 092da87f).
"""

from itertools import groupby
import os
from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest

pytestmark = [pytest.mark.ros, pytest.mark.slow]

POLICIES = Path(__file__).resolve().parents[2] / 'config' / 'security'
BENCH = 'machine_vibration'
ASKS = (
    ('topic', 'subscribe', 'get_subscriber_names_and_types_by_node'),
    ('topic', 'publish', 'get_publisher_names_and_types_by_node'),
    ('service', 'reply', 'get_service_names_and_types_by_node'),
    ('service', 'request', 'get_client_names_and_types_by_node'),
)


def full(space, node):
    return f'{space.rstrip("/")}/{node}'


def shown(observer):
    """Yield what the nodes of a graph use now, as (enclave, namespace, node, kind, verb, name)."""
    from rclpy.node import NodeNameNonExistentError

    for node, space, enclave in observer.get_node_names_and_namespaces_with_enclaves():
        if node.startswith('_'):
            continue
        for kind, verb, ask in ASKS:
            try:
                found = getattr(observer, ask)(node, space)
            except NodeNameNonExistentError:  # it has just ended
                continue
            for name, _ in found:
                yield enclave, space, node, kind, verb, name


def allowed(path):
    """Yield what a policy allows, in the same form."""
    for enclave in ElementTree.parse(path).getroot().iter('enclave'):
        for profile in enclave.iter('profile'):
            space, node = profile.get('ns'), profile.get('node')
            for group in profile:
                (verb,) = [verb for verb, rule in group.attrib.items() if rule == 'ALLOW']
                for each in group:
                    name = each.text
                    if name.startswith('~'):
                        name = full(space, node) + name[1:]
                    elif not name.startswith('/'):
                        name = full(space, name)
                    yield enclave.get('path'), space, node, each.tag, verb, name


def text(uses):
    """Return a policy."""
    policy = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(policy, 'enclaves')
    for path, of_path in groupby(sorted(uses), lambda use: use[0]):
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=path)
        profiles = ElementTree.SubElement(enclave, 'profiles')
        for (space, node), of_node in groupby(of_path, lambda use: use[1:3]):
            profile = ElementTree.SubElement(profiles, 'profile', ns=space, node=node)
            for (kind, verb), group in groupby(of_node, lambda use: use[3:5]):
                rules = ElementTree.SubElement(profile, f'{kind}s', {verb: 'ALLOW'})
                for *_, name in group:
                    own = full(space, node) + '/'
                    short = f'~/{name.removeprefix(own)}' if name.startswith(own) else name
                    ElementTree.SubElement(rules, kind).text = short
    ElementTree.indent(policy)
    return ElementTree.tostring(policy, 'unicode', xml_declaration=True) + '\n'


def test_the_middleware_here_has_no_security_as_the_page_says(tmp_path):
    """As soon as it has, the policies are to be tried with keys, and the page to be changed."""
    (tmp_path / 'enclaves').mkdir()
    keys = {'KEYSTORE': str(tmp_path), 'ENABLE': 'true', 'STRATEGY': 'Enforce'}
    done = subprocess.run(
        [sys.executable, '-c', "import rclpy; rclpy.init(); rclpy.create_node('one')"],
        env={**os.environ, **{f'ROS_SECURITY_{name}': text for name, text in keys.items()}},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode != 0
    assert "This Fast DDS version doesn't have the security libraries" in done.stderr


def test_who_has_no_keys_is_told_in_one_line(tmp_path):
    (tmp_path / 'enclaves').mkdir()
    keys = {'KEYSTORE': str(tmp_path), 'ENABLE': 'true', 'STRATEGY': 'Enforce'}
    done = subprocess.run(
        [sys.executable, '-m', 'imu_bench.cli.main', 'record', BENCH, '-o', str(tmp_path / 'bag')],
        env={**os.environ, **{f'ROS_SECURITY_{name}': text for name, text in keys.items()}},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if 'error' in line]
    assert line.startswith('imu-bench: error: ROS 2 does not start: ')
    assert f"'{tmp_path}/enclaves/imu_bench/monitor' does not exist" in line
    assert 'Traceback' not in done.stderr


def test_the_policies_allow_what_a_bench_uses_and_nothing_else(ros, tmp_path):
    from rclpy.node import Node
    import rosbags  # noqa: F401, without it nothing is recorded

    observer = ros.add(Node, '_observer')
    path, anew = POLICIES / f'{BENCH}.policy.xml', bool(os.environ.get('IMU_BENCH_WRITE_GOLDEN'))
    policy = set() if anew else set(allowed(path))
    # by then the bench runs, and what it does once a second it has done; what a policy allows and
    # it does not use is waited for to the end of the demo
    settled = re.compile(rf'^(?!0:00:0[0-{4 if anew else 0}])\d+:\d\d:\d\d', re.MULTILINE)
    command = ['demo', BENCH, '--duration', '120']
    seen, log = set(), tmp_path / 'said'
    with log.open('w') as said, subprocess.Popen(
        [sys.executable, '-m', 'imu_bench.cli.main', *command, '-o', str(tmp_path / 'demo')],
        stdout=said, stderr=said, env={**os.environ, 'IMU_BENCH_LINE_EVERY_S': '0.5'},
    ) as demo:  # fmt: skip
        ending = False
        while demo.poll() is None:
            ros.executor.spin_once(timeout_sec=0.1)
            # one that a test before has left is of no enclave
            seen.update(use for use in shown(observer) if use[0] != '/')
            if not ending and policy <= seen and settled.search(log.read_text()):
                ending = True
                demo.terminate()
    output = log.read_text()
    # 1 where the machine was too busy for the sensors
    assert demo.returncode in (0, 1), output
    assert 'Traceback' not in output
    assert 'several publish' not in output
    if anew:
        path.write_text(text(seen), encoding='utf-8')
        policy = set(allowed(path))
    assert sorted(seen - policy) == [], 'missing'
    assert sorted(policy - seen) == [], 'too much'
    names = {use[0] for use in policy}
    assert names == {f'/imu_bench/{one}' for one in ('sensors', 'analysis', 'recorder', 'monitor')}
