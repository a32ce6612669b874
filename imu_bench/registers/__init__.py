# SPDX-License-Identifier: Apache-2.0
"""
The datasheet grammar: what a chip's document prints, declared once.

A register map is a class (`RegisterMap`) whose attributes are `Register`, `Field` with its
`Codes`, `Vector`, `Scalar`, `Axis`, `Quaternion`, `Frame`, `Fifo`, and sequences of `Write`,
`Wait` and `Until`.  A driver reads it forwards (code to value), an emulator backwards (value to
code).

Attribute access on the class and on an instance returns the declaration: no access to a
declaration touches a bus, and no declaration holds a buffer.  Codes that are not one to one,
fields that overlap or do not fit, and sequences that write what cannot be written are refused
when the class is created.
"""

from imu_bench.registers.channels import Axis, Channel, Quaternion, Scalar, Vector
from imu_bench.registers.fields import Codes, describe, Field, Register, Value
from imu_bench.registers.fifo import Fifo
from imu_bench.registers.frames import Frame
from imu_bench.registers.maps import (
    Assignments,
    check_value,
    Identity,
    RegisterMap,
    Sequence,
    Typical,
    Until,
    Wait,
    Witness,
    Write,
)

__all__ = [
    'Assignments',
    'Axis',
    'Channel',
    'Codes',
    'Field',
    'Fifo',
    'Frame',
    'Identity',
    'Quaternion',
    'Register',
    'RegisterMap',
    'Scalar',
    'Sequence',
    'Typical',
    'Until',
    'Value',
    'Vector',
    'Wait',
    'Witness',
    'Write',
    'check_value',
    'describe',
]
