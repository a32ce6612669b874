# SPDX-License-Identifier: Apache-2.0
"""The buses of this computer as its files show them; nothing is opened."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import grp
import os
from pathlib import Path
import re

from imu_bench.acquisition.priority import permitted
from imu_bench.bus.opening import kind_of

PATTERNS = ('i2c-*', 'spidev*', 'ttyUSB*', 'ttyACM*', 'ttyAMA*', 'serial[0-9]*')
"""Device files; the lines ttyS of a PC say nothing, they are there without any hardware."""

GROUPS = {'i2c': 'i2c', 'spi': 'spi', 'serial': 'dialout'}

_DEV = Path('/dev')
_SYS = Path('/sys')
_MODEL = Path('/proc/device-tree/model')

LINES = {
    'i2c': 'no I²C bus: put dtparam=i2c_arm=on into /boot/firmware/config.txt, then restart',
    'spi': 'no SPI bus: put dtparam=spi=on into /boot/firmware/config.txt, then restart',
}
"""What a Raspberry Pi needs so that it has such a bus."""

LIMITS = (
    'put "@i2c - rtprio 10" into /etc/security/limits.d/imu_bench.conf (for your group; '
    'imu-bench doctor --setup prints all that is needed), then log in again'
)


@dataclass(frozen=True)
class Bus:
    """One device file."""

    device: str  # '/dev/i2c-1'
    kind: str  # 'i2c', 'spi' or 'serial'
    adapter: str  # what its kernel driver calls it; '' where it does not
    group: str
    accessible: bool  # whether this user may read and write
    speed_hz: float  # of I²C, from the device tree; 0 if it is not there

    @property
    def advice(self) -> str:
        """What to do so that this user may use it; '' if that is so."""
        if self.accessible:
            return ''
        wanted = GROUPS[self.kind]
        if self.group == wanted:
            return f'sudo usermod -aG {wanted} $USER, then log in again'
        return (
            f'it belongs to group {self.group}: sudo chgrp {wanted} {self.device} && sudo chmod '
            f'g+rw {self.device} (a udev rule keeps it so), and sudo usermod -aG {wanted} $USER'
        )


def buses() -> list[Bus]:
    """Return the device files of this computer that a sensor may be behind."""
    found = sorted({path for pattern in PATTERNS for path in _DEV.glob(pattern)})
    return [_bus(path) for path in found]


def _bus(path: Path) -> Bus:
    kind = kind_of(str(path))
    return Bus(
        str(path), kind, _text(_SYS / f'class/i2c-dev/{path.name}/name'), _group(path),
        os.access(path, os.R_OK | os.W_OK), _speed_hz(path.name) if kind == 'i2c' else 0.0,
    )  # fmt: skip


def _group(path: Path) -> str:
    number = path.stat().st_gid
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def _speed_hz(name: str) -> float:
    """Return the clock that the device tree asks for: one cell, most significant byte first."""
    for place in (f'class/i2c-adapter/{name}', f'class/i2c-dev/{name}/device'):
        try:
            cell = (_SYS / place / 'of_node/clock-frequency').read_bytes()
        except OSError:
            continue
        return float(int.from_bytes(cell[:4], 'big'))
    return 0.0


def kernel_driver(device: str, address: int) -> str:
    """Return the kernel driver that has taken a chip on I²C; '' if none has."""
    number = device.rpartition('-')[2]
    link = _SYS / f'bus/i2c/devices/{number}-{address:04x}/driver'
    return Path(os.readlink(link)).name if link.is_symlink() else ''


def model() -> str:
    """Return what computer this is, if it has a device tree."""
    return _text(_MODEL)


def is_raspberry_pi() -> bool:
    """Return whether this is a Raspberry Pi."""
    return 'Raspberry Pi' in model()


def mishandles_stretching() -> bool:
    """Return whether the I²C hardware corrupts bytes of a chip that stretches the clock."""
    newer = re.search(r'Raspberry Pi (Compute Module )?5', model())
    return is_raspberry_pi() and not newer


def lacking(found: Iterable[Bus]) -> tuple[str, ...]:
    """Return what to do about the kinds of bus that a Raspberry Pi has switched off."""
    kinds = {bus.kind for bus in found}
    return tuple(LINES[kind] for kind in LINES if is_raspberry_pi() and kind not in kinds)


def scheduling() -> tuple[str, str]:
    """Return how the threads that read will be treated, and what to do if that is not enough."""
    found = permitted()
    return found, '' if found.startswith('real time') else LIMITS


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding='utf-8', errors='replace').strip('\0\n ')
    except OSError:
        return ''
