# SPDX-License-Identifier: Apache-2.0
"""The registers of the BNO055 against those of the document."""

from imu_bench.drivers.bno055 import Bno055
from imu_bench.registers import Register

# BST-BNO055-DS000-12 rev. 1.2, tables 4-2 and 4-3: (page, address, bytes) to value after reset
SHEET = {
    (0, 0x00, 1): 0xA0,
    (0, 0x01, 3): 0xFB320F,
    (0, 0x04, 2): 0x0308,
    (None, 0x07, 1): 0,
    **{(0, address, 6): 0 for address in (0x08, 0x0E, 0x14, 0x1A, 0x28, 0x2E)},
    (0, 0x20, 8): 0,
    (0, 0x34, 1): 0,
    (0, 0x35, 1): 0,
    (0, 0x36, 1): 0x0F,
    **{(0, address, 1): 0 for address in (0x38, 0x39, 0x3A, 0x3E, 0x3F, 0x42)},
    (0, 0x3B, 1): 0x80,
    (0, 0x3D, 1): 0x10,
    (0, 0x41, 1): 0x24,
    (0, 0x55, 18): 0,
    (0, 0x67, 4): 0,
    (1, 0x08, 1): 0x0D,
    (1, 0x09, 1): 0x0B,
    (1, 0x0A, 1): 0x38,
    (1, 0x0B, 1): 0,
}
READ_ONLY = {*range(0x07), *range(0x08, 0x3B)}


def test_every_register_that_is_used_is_as_in_the_sheet():
    declared = {(r.bank, r.address, r.size): r.reset for r in Bno055.declared(Register).values()}
    assert declared == SHEET


def test_writable_registers_are_those_of_the_sheet():
    for register in Bno055.declared(Register).values():
        first = register.address
        read_only = register.bank == 0 and first in READ_ONLY
        assert register.writable is not read_only, register
