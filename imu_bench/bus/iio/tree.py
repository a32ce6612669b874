# SPDX-License-Identifier: Apache-2.0
"""What a device of Industrial I/O says of itself: Documentation/ABI/testing/sysfs-bus-iio."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from imu_bench.bus.failures import translate
from imu_bench.bus.iio.records import Element
from imu_bench.errors import BusError, ConfigError, NoAnswer
import numpy as np
import numpy.typing as npt

ROOT = Path('/')

ENABLE = 'bind the kernel driver: a device tree overlay, or "echo NAME ADDRESS" to new_device'
RULE = (
    'root alone may set it up; a udev rule such as SUBSYSTEM=="iio", RUN+="/bin/chgrp -R iio '
    '/sys%p", RUN+="/bin/chmod -R g+w /sys%p" lets the group iio'
)


def devices(root: Path | None = None) -> dict[str, str]:
    """
    Return the devices that a kernel driver has bound, 'iio:device0' and so on, by their name.

    Parameters
    ----------
    root : Path, optional
        Under which sys and dev are.
    """
    folder = (root or ROOT) / 'sys/bus/iio/devices'
    found = sorted(folder.glob('iio:device*'), key=lambda path: (len(path.name), path.name))
    return {path.name: _read(path / 'name') for path in found}


class IioDevice:
    """
    One device, by its files.

    Parameters
    ----------
    name : str
        'iio:device0', or the name that its driver gives it where only one has it.
    root : Path, optional
        Under which sys and dev are.

    Raises
    ------
    NoAnswer
        If there is no such device, with those there are.
    """

    def __init__(self, name: str, root: Path | None = None) -> None:
        root = root or ROOT
        known = devices(root)
        alike = [device for device, called in known.items() if name in (device, called)]
        if len(alike) != 1:
            there = ', '.join(f'{device} ({called})' for device, called in known.items())
            raise NoAnswer(
                f'{name}: {"no such device" if not alike else "several are called so"} of '
                f'Industrial I/O; there are: {there or "none"}; {ENABLE}'
            )
        self.name = alike[0]
        self.called = known[self.name]
        self.node = root / 'dev' / self.name
        self._folder = root / 'sys/bus/iio/devices' / self.name
        self._triggers = root / 'sys/bus/iio/devices'

    def has(self, file: str) -> bool:
        """Return whether there is such a file."""
        return (self._folder / file).exists()

    def get(self, file: str) -> str:
        """
        Return what a file says.

        Raises
        ------
        BusError
            If it cannot be read.
        """
        try:
            return (self._folder / file).read_text('utf-8').strip()
        except OSError as error:
            raise self._failed(file, error) from error

    def first(self, *files: str) -> str | None:
        """Return what the first of some files says that there is."""
        return next((self.get(file) for file in files if self.has(file)), None)

    def set(self, file: str, value: object) -> None:
        """
        Write a file.

        Raises
        ------
        BusError
            If the kernel refuses it, with what it would take.
        """
        path = self._folder / file
        try:
            path.write_text(f'{value}\n', 'utf-8')
        except OSError as error:
            available = self.first(f'{file}_available')
            allowed = f'; allowed: {available}' if available else ''
            raise self._failed(f'{file} = {value}{allowed}', error) from error

    @property
    def scan(self) -> str:
        """The folder of the scan elements: that of the one buffer most devices have."""
        return 'scan_elements' if self.has('scan_elements') else 'buffer0'

    @property
    def buffer(self) -> str:
        """The folder of the buffer."""
        return 'buffer' if self.has('buffer') else 'buffer0'

    def channels(self) -> dict[str, Element]:
        """
        Return the channels that can be in the buffer, such as 'accel_x', by their index.

        Raises
        ------
        ConfigError
            If a type is not known.
        NoAnswer
            If it has no buffer.
        """
        files = sorted((self._folder / self.scan).glob('in_*_type'))
        if not files:
            raise NoAnswer(
                f'{self.name}: {self.called} has no buffer; without an interrupt or a trigger the '
                'kernel driver offers single readings only'
            )
        names = [path.name.removeprefix('in_').removesuffix('_type') for path in files]
        ordered = sorted(names, key=lambda name: int(self.get(f'{self.scan}/in_{name}_index')))
        found = {}
        for name in ordered:
            text = self.get(f'{self.scan}/in_{name}_type')
            try:
                found[name] = Element.parse(text)
            except ConfigError as error:
                raise ConfigError(f'{self.name}: in_{name}_type: {error}') from error
        return found

    def line(self, channel: str) -> tuple[float, float]:
        """Return scale and offset of a channel: its own, or that of its kind."""
        kind = channel.rpartition('_')[0] or channel
        scale, offset = (
            self.first(f'in_{channel}_{what}', f'in_{kind}_{what}') for what in ('scale', 'offset')
        )
        return float(scale or 1.0), float(offset or 0.0)

    def mount_matrix(self, kind: str) -> npt.NDArray[np.float64]:
        """Return the matrix that turns a vector of the chip into the frame of the device."""
        for file in (f'in_{kind}_mount_matrix', 'in_mount_matrix', 'mount_matrix'):
            if self.has(file):
                text = self.get(file)
                try:
                    rows = [[float(x) for x in row.split(',')] for row in text.split(';')]
                    return np.array(rows, np.float64).reshape(3, 3)
                except ValueError as error:
                    raise ConfigError(f'{self.name}: {file}: {text!r} is no matrix') from error
        return np.eye(3)

    def triggers(self) -> Iterator[str]:
        """Yield the names of the triggers there are."""
        for path in sorted(self._triggers.glob('trigger*')):
            yield _read(path / 'name')

    def _failed(self, what: str, error: OSError) -> BusError:
        where = f'{self.name} {what}'
        if isinstance(error, PermissionError):
            return translate(error, f'{where}: {RULE}', group='iio', enable=ENABLE)
        return translate(error, where, group='iio', enable=ENABLE)


def _read(path: Path) -> str:
    return path.read_text('utf-8').strip() if path.exists() else ''
