# SPDX-License-Identifier: Apache-2.0
"""
The files that a computer needs for a bench: who may use its buses, and before whom.

Written for Raspberry Pi OS; what they say of a Raspberry Pi and where it is written stands in
docs/raspberry_pi.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
import re
import shlex

from imu_bench import wires
from imu_bench.acquisition.priority import PRIORITY
from imu_bench.config import BenchConfig, SensorConfig
from imu_bench.errors import ConfigError

BOOT = 'boot/firmware'
CONFIG, OURS = f'{BOOT}/config.txt', f'{BOOT}/imu_bench.txt'
UNIT = 'etc/systemd/system/imu_bench.service'

GROUPS = ('i2c', 'spi', 'gpio', 'dialout')
"""Those that Raspberry Pi OS has for its buses."""

INCLUDE = 'include imu_bench.txt'

_UDEV = """\
# Buses belong to groups, so that nobody needs to be root.
SUBSYSTEM=="i2c-dev", GROUP="i2c", MODE="0660"
SUBSYSTEM=="spidev", GROUP="spi", MODE="0660"
SUBSYSTEM=="gpio", KERNEL=="gpiochip*", GROUP="gpio", MODE="0660"
SUBSYSTEM=="tty", KERNEL=="ttyAMA[0-9]*|ttyUSB[0-9]*|ttyACM[0-9]*", GROUP="dialout", MODE="0660"
# Sensors of Xsens, and its converters with a chip of FTDI, are no modems.
ACTION!="remove", SUBSYSTEM=="tty", ATTRS{idVendor}=="2639", ENV{ID_MM_DEVICE_IGNORE}="1"
ACTION!="remove", SUBSYSTEM=="tty", ATTRS{idVendor}=="0403", ENV{ID_MM_DEVICE_IGNORE}="1"
# Nor are microcontrollers: ST-LINK of a Nucleo, Arduino, Teensy.
ACTION!="remove", SUBSYSTEM=="tty", ATTRS{idVendor}=="0483|2341|16c0", ENV{ID_MM_DEVICE_IGNORE}="1"
# A converter of FTDI keeps bytes for 16 ms unless told otherwise.
ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"
"""

_UNIT = """\
[Unit]
Description=imu_bench records {bench} from the start of the computer on
After=local-fs.target time-sync.target
Wants=time-sync.target

[Service]
User={user}
SupplementaryGroups={groups}
StateDirectory=imu_bench
WorkingDirectory=/var/lib/imu_bench
ExecStart=/bin/sh -c 'exec {command} record {bench} -o recording_$$(date +%%Y-%%m-%%dT%%H-%%M-%%S)'
# ends with a bag that is complete
KillSignal=SIGTERM
KillMode=mixed
TimeoutStopSec=90
Restart=on-failure
RestartSec=5
LimitRTPRIO={priority}
LimitMEMLOCK=infinity

[Install]
WantedBy=multi-user.target
"""


def files(config: BenchConfig | None, name: str, user: str, command: str) -> dict[str, str]:
    """
    Return what is to be written, by the path below the root.

    Parameters
    ----------
    config : BenchConfig or None
        The bench whose buses are switched on and which the unit records; None for neither.
    name : str
        How the bench is named on the command line; an absolute path for a file.
    user : str
        Who records.
    command : str
        Path of the executable ``imu-bench``.

    Raises
    ------
    ConfigError
        If a bus of the bench is none that a Raspberry Pi has.
    """
    members = ''.join(f'm {user} {group}\n' for group in GROUPS)
    found = {
        'etc/udev/rules.d/90-imu_bench.rules': _UDEV,
        'etc/sysusers.d/imu_bench.conf': ''.join(f'g {group} -\n' for group in GROUPS) + members,
        'etc/security/limits.d/90-imu_bench.conf': (
            f'{user} - rtprio {PRIORITY}\n{user} - memlock unlimited\n'
        ),
        # a core that has to speed up first is late
        'etc/tmpfiles.d/imu_bench.conf': (
            'w /sys/devices/system/cpu/cpufreq/policy*/scaling_governor - - - - performance\n'
        ),
    }
    if config is not None:
        lines = [*dict.fromkeys(line for sensor in config.sensors for line in _switches(sensor))]
        if any('i2c' in line for line in lines):
            # no /dev/i2c-1 without it; raspi-config loads it, too
            found['etc/modules-load.d/imu_bench.conf'] = 'i2c-dev\n'
        found[OURS] = ''.join(f'{line}\n' for line in ['# buses of imu_bench', *sorted(lines)])
        found[UNIT] = _UNIT.format(
            bench=shlex.quote(name).replace('%', '%%'), user=user, groups=' '.join(GROUPS),
            command=shlex.quote(command).replace('%', '%%'), priority=PRIORITY,
        )  # fmt: skip
    return found


def _switches(sensor: SensorConfig) -> Iterator[str]:
    """Yield the lines of config.txt that the bus of a sensor needs."""
    wire = wires.wire_of(sensor)
    kind = wires.kind_of_bus(sensor) if wire else ''
    if kind == 'i2c':
        yield from _i2c(sensor, int(wire.rpartition('-')[2]))
    elif kind == 'daqhat' or (kind in ('spi', 'frame') and wire == 'spidev0'):
        yield 'dtparam=spi=on'
    elif kind in ('spi', 'frame') and wire == 'spidev1':
        yield 'dtoverlay=spi1-3cs'
    elif kind in ('spi', 'frame'):
        raise ConfigError(f'{sensor.name}: {wire}: a Raspberry Pi has spidev0 and spidev1')
    elif kind == 'serial' and re.fullmatch(r'ttyAMA0|serial0', wire):
        # the good one of its serial lines goes to Bluetooth otherwise; the 5 has another
        yield from ('[pi5]\ndtparam=uart0=on\n[all]', '[pi4]\ndtoverlay=disable-bt\n[all]')


def _i2c(sensor: SensorConfig, number: int) -> Iterator[str]:
    if number == 1:
        yield 'dtparam=i2c_arm=on,i2c_arm_baudrate=400000'
    elif number == 3:
        # in software, which waits for a chip that stretches the clock
        yield f'dtoverlay=i2c-gpio,bus={number},i2c_gpio_sda=17,i2c_gpio_scl=27'
    elif number == 6:
        yield '[pi4]\ndtoverlay=i2c6,pins_22_23,baudrate=400000\n[all]'
    else:
        raise ConfigError(
            f'{sensor.name}: i2c-{number}: write its line of config.txt yourself; known are '
            'i2c-1, i2c-3 (software, for the BNO055) and i2c-6'
        )


def write(found: Mapping[str, str], root: Path) -> list[Path]:
    """
    Write files below a root, and have config.txt include ours; return what changed.

    Raises
    ------
    ConfigError
        If something cannot be written.
    """
    wanted = dict(found)
    try:
        if OURS in wanted:
            config = root / CONFIG
            text = config.read_text(encoding='utf-8') if config.exists() else ''
            if INCLUDE not in text.splitlines():
                # a filter such as [cm4] may be in force at its end
                wanted[CONFIG] = f'{text.rstrip()}\n\n[all]\n{INCLUDE}\n'.lstrip()
        changed = []
        for name, text in wanted.items():
            path = root / name
            if path.exists() and path.read_text(encoding='utf-8') == text:
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding='utf-8')
            changed.append(path)
    except OSError as error:
        raise ConfigError(
            f'{error.filename}: cannot be written: {error.strerror}; say sudo, or --root FOLDER'
        ) from error
    return changed


def afterwards(found: Mapping[str, str]) -> list[str]:
    """Return the commands that put the files into force."""
    commands = [
        'sudo systemd-sysusers',
        'sudo udevadm control --reload',
        'sudo udevadm trigger',
        'sudo systemd-tmpfiles --create imu_bench.conf',
    ]
    if UNIT in found:
        name = PurePosixPath(UNIT).name
        commands += ['sudo systemctl daemon-reload', f'sudo systemctl enable {name}']
    return [*commands, 'sudo reboot']
