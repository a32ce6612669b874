# SPDX-License-Identifier: Apache-2.0
"""The files that a computer needs, written into an empty root and read by those they are for."""

from pathlib import Path
import re
import shutil
import subprocess

from imu_bench.acquisition.priority import PRIORITY
from imu_bench.bench import load_bench
from imu_bench.cli.main import main
from imu_bench.config.location import config_file
from imu_bench.doctor import setup
from imu_bench.errors import ConfigError
import pytest

BENCHES = ('machine_vibration', 'mast_inclination', 'vehicle_vibration')
ROOT = Path(__file__).parents[2]
PART = r'[A-Z]+(\{[\w/]+\})?(==|!=|=|\+=|-=|:=)"[^"]*"'
ASSIGNMENTS = re.compile(f'{PART}(, {PART})*')


@pytest.fixture
def written(tmp_path, capsys):
    def write(bench, *more):
        root = tmp_path / 'root'
        assert main(
            ['doctor', '--setup', '--apply', '--root', str(root), '--user', 'ada', bench, *more]
        ) == 0  # fmt: skip
        return root, capsys.readouterr().out

    return write


def said(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def test_what_is_written_is_what_is_printed(written, capsys):
    bench = 'machine_vibration_hardware'
    root, told = written(bench)
    assert main(['doctor', '--setup', '--user', 'ada', bench]) == 0
    printed = capsys.readouterr().out
    files = [path for path in root.rglob('*') if path.is_file()]
    assert len(files) == 8
    for path in files:
        if path.name != 'config.txt':
            assert path.read_text() in printed
            assert f'/{path.relative_to(root)}' in printed
        assert f'wrote {path}' in told
    assert 'sudo systemctl enable imu_bench.service' in told


def test_without_a_bench_no_bus_is_switched_on(tmp_path):
    assert set(setup.files(None, '', 'ada', '/usr/bin/imu-bench')) == {
        'etc/udev/rules.d/90-imu_bench.rules', 'etc/sysusers.d/imu_bench.conf',
        'etc/security/limits.d/90-imu_bench.conf', 'etc/tmpfiles.d/imu_bench.conf',
    }  # fmt: skip


def test_udev_understands_the_rules(written):
    root, _ = written('machine_vibration_hardware')
    rules = root / 'etc/udev/rules.d/90-imu_bench.rules'
    lines = [line for line in rules.read_text().splitlines() if line[:1] not in ('', '#')]
    assert lines
    for line in lines:
        assert ASSIGNMENTS.fullmatch(line), line
    if shutil.which('udevadm') and said('udevadm', 'verify', '--help')[0] == 0:  # systemd 254
        assert said('udevadm', 'verify', str(rules))[0] == 0


@pytest.mark.skipif(not shutil.which('systemd-analyze'), reason='no systemd here')
def test_systemd_understands_the_unit(written, monkeypatch, tmp_path):
    monkeypatch.setattr(shutil, 'which', lambda name: '/bin/true')
    root, _ = written('machine_vibration_hardware')
    monkeypatch.undo()
    unit = root / setup.UNIT
    text = unit.read_text()
    assert f'LimitRTPRIO={PRIORITY}' in text
    assert 'User=ada' in text
    # who verifies has no ada
    unit.write_text(text.replace('User=ada', 'User=root'))
    code, told = said('systemd-analyze', 'verify', str(unit))
    assert (code, [line for line in told.splitlines() if 'imu_bench' in line]) == (0, [])
    # and a unit with a mistake is noticed
    unit.write_text(text.replace('LimitRTPRIO=', 'LimitRTPRIOR='))
    assert 'LimitRTPRIOR' in said('systemd-analyze', 'verify', str(unit))[1]


@pytest.mark.skipif(not shutil.which('systemd-sysusers'), reason='no systemd here')
def test_sysusers_puts_the_user_into_the_groups(written):
    root, _ = written('mast_inclination_hardware')
    (root / 'etc/passwd').write_text('ada:x:1000:1000::/home/ada:/bin/sh\n')
    (root / 'etc/group').write_text('ada:x:1000:\n')
    code, told = said('systemd-sysusers', f'--root={root}')
    assert code == 0, told
    groups = (root / 'etc/group').read_text()
    for group in setup.GROUPS:
        assert re.search(rf'^{group}:x:\d+:ada$', groups, re.MULTILINE), groups


@pytest.mark.skipif(not shutil.which('systemd-tmpfiles'), reason='no systemd here')
def test_tmpfiles_sets_every_governor(written):
    root, _ = written('mast_inclination_hardware')
    governors = [
        root / f'sys/devices/system/cpu/cpufreq/policy{n}/scaling_governor' for n in (0, 4)
    ]
    for governor in governors:
        governor.parent.mkdir(parents=True)
        governor.write_text('ondemand\n')
    code, told = said('systemd-tmpfiles', f'--root={root}', '--create', 'imu_bench.conf')
    assert code == 0, told
    assert [governor.read_text().strip() for governor in governors] == ['performance'] * 2


def test_limits_are_those_that_the_threads_ask_for(written):
    root, _ = written('mast_inclination_hardware')
    lines = (root / 'etc/security/limits.d/90-imu_bench.conf').read_text().splitlines()
    assert [line.split() for line in lines] == [
        ['ada', '-', 'rtprio', str(PRIORITY)], ['ada', '-', 'memlock', 'unlimited'],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('bench', 'lines'),
    [
        ('machine_vibration', {
            'dtparam=i2c_arm=on,i2c_arm_baudrate=400000', 'dtparam=uart0=on',
            'dtoverlay=i2c6,pins_22_23,baudrate=400000', 'dtoverlay=disable-bt',
            'dtparam=spi=on',
        }),
        ('mast_inclination', {'dtparam=spi=on'}),
        ('vehicle_vibration', {
            'dtparam=i2c_arm=on,i2c_arm_baudrate=400000',
            'dtoverlay=i2c6,pins_22_23,baudrate=400000',
        }),
    ],
)  # fmt: skip
def test_the_buses_of_a_bench_are_switched_on(written, bench, lines):
    root, _ = written(f'{bench}_hardware')
    ours = (root / setup.OURS).read_text().splitlines()
    assert {line for line in ours if line.startswith('dt')} == lines
    # what stands behind a filter for one model ends with it
    filters = [line for line in ours if line.startswith('[')]
    assert filters[1::2] == ['[all]'] * len(filters[1::2])
    assert (root / setup.CONFIG).read_text().splitlines()[-2:] == ['[all]', setup.INCLUDE]


@pytest.mark.parametrize(
    ('bench', 'modules'), [('machine_vibration', ['i2c-dev']), ('mast_inclination', [])]
)
def test_what_makes_devices_of_i2c_buses_is_loaded(written, bench, modules):
    # dtparam=i2c_arm=on alone makes no /dev/i2c-1: raspi-config loads the module, too
    root, _ = written(f'{bench}_hardware')
    found = [path.read_text().split() for path in root.glob('etc/modules-load.d/*.conf')]
    assert found == ([modules] if modules else [])


def test_what_config_txt_had_stays_and_nothing_is_written_twice(written, tmp_path):
    config = tmp_path / 'root' / setup.CONFIG
    config.parent.mkdir(parents=True)
    config.write_text('dtparam=audio=on\n\n[cm4]\notg_mode=1\n')
    written('mast_inclination_hardware')
    assert config.read_text() == (
        'dtparam=audio=on\n\n[cm4]\notg_mode=1\n\n[all]\ninclude imu_bench.txt\n'
    )
    _, told = written('mast_inclination_hardware')
    assert 'wrote' not in told
    assert config.read_text().count('include') == 1


def test_a_bus_that_is_not_known_is_said_and_so_is_a_folder_that_is_not_ours(tmp_path):
    bench = load_bench(config_file('benches/mast_inclination_hardware.yaml'))
    object.__setattr__(bench.sensors[0], 'bus', 'spidev7.0')
    with pytest.raises(ConfigError, match=r'scl3300: spidev7: a Raspberry Pi has'):
        setup.files(bench, 'x', 'ada', 'imu-bench')
    (tmp_path / 'etc').write_text('')
    with pytest.raises(ConfigError, match=r'cannot be written: .*; say sudo'):
        setup.write(setup.files(None, '', 'ada', 'imu-bench'), tmp_path)


def test_the_page_has_the_lines_that_are_generated():
    """What a reader sees in docs/raspberry_pi.md is what --setup writes."""
    page = (ROOT / 'docs' / 'raspberry_pi.md').read_text()
    for name in BENCHES:
        bench = load_bench(config_file(f'benches/{name}_hardware.yaml'))
        for line in setup.files(bench, name, 'ada', 'imu-bench')[setup.OURS].splitlines():
            assert line.startswith(('#', '[')) or line in page, line
