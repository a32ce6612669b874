# SPDX-License-Identifier: Apache-2.0
"""What a chip has found out about itself, kept in a file."""

from __future__ import annotations

from pathlib import Path

from imu_bench.bus.register_access import Registers
from imu_bench.errors import BusError, ConfigError
from imu_bench.registers import Register


class CalibrationProfile:
    """
    The bytes of some registers, in their order and nothing else, as Linux keeps them.

    A file that is there is never written: what a sensor measures would change from one recording
    to the next, and nobody would know.

    Parameters
    ----------
    path : str
        Empty for none.
    *places : Register
        Those that are kept.

    Raises
    ------
    ConfigError
        If the file holds something else.
    """

    def __init__(self, path: str, registers: Registers, *places: Register) -> None:
        self._path = Path(path)
        self._registers, self._places = registers, places
        self.wanted = bool(path)
        """There is no file yet."""
        if path:
            self._load()

    def _load(self) -> bytes:
        size = sum(place.size for place in self._places)
        try:
            data = self._path.read_bytes()
        except FileNotFoundError:
            return b''
        except OSError as error:
            raise ConfigError(f'calibration_file {self._path}: {error.strerror}') from error
        if len(data) != size:
            raise ConfigError(
                f'calibration_file {self._path}: {len(data)} bytes, a profile has {size}; '
                'take it away and calibrate again'
            )
        self.wanted = False
        return data

    def restore(self) -> None:
        """
        Write what is in the file, if there is one, and read it back.

        Raises
        ------
        BusError
            If the chip does not take it.
        """
        data = self._load() if self._path.name else b''
        if not data:
            return
        values = {}
        for place in self._places:
            values[place] = place.unpack(data[: place.size])
            data = data[place.size :]
        self._registers.write(values)
        if refused := self._registers.difference(values):
            raise BusError(
                f'{refused}: the offsets of {self._path} are not of this chip, or beyond what it '
                'takes; take the file away and calibrate again'
            )

    def read(self) -> bytes:
        """Return what the chip holds."""
        return b''.join(self._registers.burst(place) for place in self._places)

    def write(self, data: bytes) -> None:
        """
        Write the file, completely or not at all; it is tried once.

        Raises
        ------
        ConfigError
            If it cannot be written.
        """
        self.wanted = False
        draft = self._path.with_name(f'.unfinished-{self._path.name}')
        try:
            draft.write_bytes(data)
            draft.replace(self._path)
        except OSError as error:
            raise ConfigError(f'calibration_file {self._path}: {error.strerror}') from error
