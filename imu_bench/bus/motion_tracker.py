# SPDX-License-Identifier: Apache-2.0
"""The states and settings of an Xsens motion tracker (LLCP, MT0101P 2020.A)."""

from __future__ import annotations

import struct

from imu_bench.bus.framing import xbus
from imu_bench.bus.framing.xbus import Mid, Output
from imu_bench.bus.xbus_port import XbusPort
from imu_bench.errors import BusError, NoAnswer

SLOT_S = 0.1
"""GoToConfig gets lost in a stream of data and is repeated so often."""

TRIES, SHORT_TRIES, RESET_TRIES = 17, 3, 10


class MotionTracker:
    """
    Config and measurement, speed of the line, identity, outputs; each checked.

    Parameters
    ----------
    baud : int
        Speed to which a device on a serial line is brought; 0 on USB.
    """

    def __init__(self, port: XbusPort, baud: int) -> None:
        self._port = port
        self._baud = baud
        self._met = False

    def go_to_config(self) -> None:
        """
        Stop the stream, whatever the device does, and at whatever speed it talks.

        Raises
        ------
        NoAnswer
            If nothing answers.
        """
        if self._baud:
            self._port.set_baud(self._baud)
        try:
            self._port.request(Mid.GO_TO_CONFIG, timeout_s=SLOT_S, tries=TRIES)
        except NoAnswer:
            if self._baud and not self._met:
                self._change_speed()
            else:
                self._port.send(Mid.RESET)
            self._port.request(Mid.GO_TO_CONFIG, timeout_s=SLOT_S, tries=RESET_TRIES)
        self._met = True

    def _change_speed(self) -> None:
        """Look for a device that talks at another speed; let it change, with a reset (LLCP)."""
        for baud in (115_200, 460_800, 230_400, 921_600):
            if baud == self._baud:
                continue
            self._port.set_baud(baud)
            try:
                self._port.request(Mid.GO_TO_CONFIG, timeout_s=SLOT_S, tries=SHORT_TRIES)
            except NoAnswer:
                continue
            self._port.request(Mid.BAUD_RATE, bytes([xbus.BAUD_CODES[self._baud]]))
            self._port.send(Mid.RESET)
            break
        self._port.set_baud(self._baud)

    def identity(self) -> tuple[str, str, str]:
        """Return product code, device id and firmware revision."""
        product = self._port.request(Mid.REQ_PRODUCT_CODE).decode('ascii', 'replace')
        number = self._port.request(Mid.REQ_DEVICE_ID).hex().upper()
        firmware = '.'.join(str(part) for part in self._port.request(Mid.REQ_FIRMWARE)[:3])
        return product.strip(' \0'), number, firmware

    def set_filter_profile(self, profile: int) -> None:
        """
        Choose the profile of the orientation filter, and compare with what the device has.

        Raises
        ------
        BusError
            If it has another one.
        """
        self._port.request(Mid.FILTER_PROFILE, struct.pack('>H', profile))
        # the document gives two bytes and not their meaning; a driver for ROS (ETH) sets the
        # second one
        self._compare('filter profile', profile, self._port.request(Mid.FILTER_PROFILE)[-1:])

    def set_outputs(self, outputs: tuple[Output, ...]) -> None:
        """
        Choose the outputs; compare with the acknowledge, and with what the device then holds.

        Raises
        ------
        BusError
            If the device gives something else, such as a lower rate.
        """
        for data in (xbus.pack_outputs(outputs), b''):
            given = xbus.unpack_outputs(self._port.request(Mid.OUTPUT_CONFIGURATION, data))
            self._compare('output configuration', outputs, given)

    def measure(self) -> None:
        """Start the stream."""
        self._port.request(Mid.GO_TO_MEASUREMENT)

    def _compare(self, what: str, asked: object, given: object) -> None:
        if isinstance(given, bytes):
            given = given[0] if given else None
        if asked != given:
            raise BusError(
                f'{self._port.name}: {what} was set to {asked!r}, but the device has {given!r}; '
                'is it an MTi of the 100 series?'
            )
