# SPDX-License-Identifier: Apache-2.0
"""The datasheet grammar refuses wrong declarations, and never changes a value by itself."""

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.registers import (
    Codes,
    describe,
    Field,
    Frame,
    Register,
    RegisterMap,
    Scalar,
    Until,
    Vector,
    Wait,
    Write,
)
import numpy as np
import pytest


class Chip(RegisterMap):
    STATUS = Register(0x00, access='ro', clear_on_read=True)
    CTRL = Register(0x10, reset=0x07)
    COMMAND = Register(0x11, access='wo')
    WIDE = Register(0x12, size=2, order='little')
    OUT = Register(0x28, access='ro', size=6, reset=None)
    BANKED = Register(0x10, bank=1, part='other')

    scale = Field(CTRL, (5, 4), Codes({2: 0, 4: 1, 8: 2, 16: 3}), 'g')
    rate = Field(CTRL, (3, 0), Codes({1000 / 3: 2, 100.0: 5}), 'Hz')
    on = Field(CTRL, 7, Codes({True: 1, False: 0}))
    mode = Field(CTRL, 6, Codes({'slow': 0, 'fast': 1}))
    level = Field(WIDE, (11, 3))

    acceleration = Vector(
        first=OUT,
        quantity='acceleration',
        unit='m/s²',
        dtype='<i2',
        scaled_by=scale,
        si_per_lsb={2: 1.0, 4: 2.0, 8: 4.0, 16: 12.0},
        shift=4,
        axes=((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    )


# --- codes -------------------------------------------------------------------------------
def test_two_values_with_one_code_are_refused():
    # the table of a light sensor in a public driver has had gain 4 and gain 8 both as 0b011
    with pytest.raises(ConfigError, match=r'0x3 stands for both 4 and 8'):
        Codes({1: 0, 2: 1, 4: 3, 8: 3})


def test_an_alias_is_read_and_never_written():
    codes = Codes({'mode 1': 0}, aliases={4: ('mode 1', 'wake up is the mode 1 command')})
    assert codes.value(4) == 'mode 1'
    assert codes['mode 1'] == 0
    assert codes.all_codes == (0, 4)


@pytest.mark.parametrize(
    'aliases',
    [{0: ('a', 'code is taken')}, {1: ('b', 'value is not declared')}, {1: ('a', '')}],
)
def test_an_alias_needs_its_own_code_a_value_and_a_reason(aliases):
    with pytest.raises(ConfigError, match='alias'):
        Codes({'a': 0}, aliases=aliases)


def test_long_tables_are_described_by_their_ends():
    text = describe(Codes({float(n): n for n in range(1, 40)}), 'Hz')
    assert text == '1, 2, 3, … 37, 38, 39 (39 values) Hz'


# --- values ------------------------------------------------------------------------------
@pytest.mark.parametrize('value', [3, 5.0, -2, 'fast', None, True, float('nan'), 2.001])
def test_a_value_outside_is_an_error_with_the_list(value):
    with pytest.raises(ConfigError, match=r'scale in register CTRL \(0x10\).*2, 4, 8, 16 g'):
        Chip.scale.encode(value)


def test_a_float_may_be_rounded_but_a_neighbour_is_not_taken():
    assert Chip.rate.encode(333.33333) == 2
    with pytest.raises(ConfigError):
        Chip.rate.encode(333.0)


def test_words_and_flags_are_not_numbers():
    assert Chip.on.encode(True) == 1
    assert Chip.mode.encode('fast') == 1
    with pytest.raises(ConfigError):
        Chip.on.encode(1)
    with pytest.raises(ConfigError):
        Chip.mode.encode(1)


def test_a_code_without_meaning_is_an_error():
    with pytest.raises(ConfigError, match='0x3 has no meaning'):
        Chip.rate.decode(3)


@pytest.mark.parametrize('value', [-1, 512, 1.0, '1'])
def test_a_field_without_a_table_takes_its_codes_only(value):
    with pytest.raises(ConfigError, match='0 to 511'):
        Chip.level.encode(value)


@given(word=st.integers(0, 0xFFFF), value=st.integers(0, 511))
def test_insert_changes_the_field_and_nothing_else(word, value):
    changed = Chip.level.insert(word, value)
    assert Chip.level.extract(changed) == value
    assert changed & ~Chip.level.mask == word & ~Chip.level.mask


# --- declarations ------------------------------------------------------------------------
def test_class_and_instance_give_the_declaration():
    assert Chip.scale is Chip().scale
    assert Chip.scale.name == 'scale'
    assert Chip.scale.register is Chip.CTRL
    assert Chip.scale.allowed == (2, 4, 8, 16)


def test_a_declaration_cannot_be_assigned_to():
    with pytest.raises(AttributeError, match='declaration'):
        Chip().scale = 4


def test_numbers_carry_the_bank():
    assert Chip.CTRL.number == 0x10
    assert Chip.BANKED.number == 0x210
    assert str(Chip.BANKED) == 'other BANKED (0x10 of bank 1)'


def test_byte_order():
    assert Chip.WIDE.pack(0x0102) == b'\x02\x01'
    assert Chip.WIDE.unpack(b'\x02\x01') == 0x0102


def test_subclasses_inherit_declarations():
    class Newer(Chip):
        EXTRA = Register(0x40)

    assert set(Newer.declared(Register)) == {*Chip.declared(Register), 'EXTRA'}


@pytest.mark.parametrize(
    ('body', 'problem'),
    [
        (lambda: {'A': Register(0x10), 'B': Register(0x0F, size=2)}, 'overlap'),
        (lambda: {'A': Register(0x10, bank=1), 'B': Register(0x10)}, 'overlap'),
        (lambda: {'f': Field(Register(0x10), 1)}, 'does not declare'),
        (lambda: _two_fields((3, 1), 3), 'fields one and other of A .* overlap'),
        (lambda: _with_sequence(Register(0x10, access='ro'), 1), 'read only'),
        (lambda: _with_sequence(Register(0x10), 256), '0 to 255'),
    ],
)
def test_wrong_maps_are_refused_when_the_class_is_created(body, problem):
    with pytest.raises(ConfigError, match=f'Wrong: .*{problem}'):
        type('Wrong', (RegisterMap,), body())


def _two_fields(one, other):
    register = Register(0x10)
    return {'A': register, 'one': Field(register, one), 'other': Field(register, other)}


def _with_sequence(register, value):
    return {'A': register, 'start': (Wait(0.1), Write({register: value}))}


def test_the_same_address_in_two_banks_or_two_dies_is_fine():
    class Fine(RegisterMap):
        A = Register(0x10, bank=0)
        B = Register(0x10, bank=1)
        C = Register(0x10, part='magnetometer')

    assert len(Fine.declared(Register)) == 3


def test_registers_may_be_words():
    class Words(RegisterMap):
        X = Register(0x01, size=2, addresses=1)
        Y = Register(0x02, size=2, addresses=1)

    assert Words.Y.span == 1


@pytest.mark.parametrize(
    'make',
    [
        lambda: Register(0x10, access='rx'),
        lambda: Register(0x10, order='middle'),
        lambda: Register(0x10, reset=0x100),
        lambda: Field(Register(0x10), 8),
        lambda: Field(Register(0x10), (2, 3)),
        lambda: Field(Register(0x10), (1, 0), Codes({'a': 4})),
    ],
)
def test_what_does_not_fit_is_refused(make):
    with pytest.raises(ConfigError):
        make()


def test_sequences_are_found_and_grouped():
    class Steps(RegisterMap):
        A = Register(0x10)
        B = Register(0x11)
        one = Field(A, 0)
        two = Field(A, 1)
        other = Field(B, 0)
        start = (Write({one: 1, other: 1, two: 1}), Wait(0.1), Until(other, 0, timeout_s=1.0))
        not_a_sequence = (1, 2)

    assert list(Steps.sequences()) == ['start']
    grouped = Steps.start[0].by_register()
    assert list(grouped) == [Steps.A, Steps.B]
    assert list(grouped[Steps.A]) == [Steps.one, Steps.two]


# --- channels ----------------------------------------------------------------------------
def test_left_justified_words_are_shifted_and_axes_turned():
    words = np.array([[0x0010, 0x0020, -0x0010]], dtype='<i2')
    np.testing.assert_array_equal(Chip.acceleration.decode(words, 4), [[4.0, -2.0, -2.0]])


def test_a_reading_at_the_limit_is_saturated():
    words = np.array([[0, 0, 0x7FF0], [0, -0x8000, 0], [0, 0x7FE0, 0]], dtype='<i2')
    assert Chip.acceleration.saturated(words).tolist() == [True, True, False]
    assert Chip.acceleration.saturated(words[:0]).tolist() == []


@pytest.mark.slow
@given(
    st.lists(st.tuples(*[st.floats(-4e4, 4e4)] * 3), min_size=1, max_size=5),
    st.sampled_from([2, 4, 8, 16]),
)
def test_encode_is_decode_backwards_within_half_an_lsb(vectors, range_):
    si = np.array(vectors)
    back = Chip.acceleration.decode(Chip.acceleration.encode(si, range_), range_)
    lsb = Chip.acceleration.resolution(range_)
    inside = np.abs(si) <= 2047 * lsb
    assert (np.abs(back - si)[inside] <= lsb[0] / 2 * (1 + 1e-12)).all()
    assert (np.sign(si) * back >= 2047 * lsb)[~inside].all()


def test_each_component_may_have_its_own_factor():
    # X, Z, Y in the registers, Z with another gain: LSM303DLHC
    out = Register(0x03, access='ro', size=6, reset=None)
    field = Vector(
        first=out,
        quantity='magnetic_field',
        unit='T',
        dtype='>i2',
        si_per_lsb=(1.0, 10.0, 1.0),
        limits=(-2048, 2047),
        axes=((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    )
    words = np.array([[1, 2, 3]], dtype='>i2')
    assert field.decode(words).tolist() == [[1.0, 3.0, 20.0]]
    assert field.encode(np.array([[1.0, 3.0, 20.0]])).tolist() == [[1, 2, 3]]
    assert field.resolution().tolist() == [1.0, 1.0, 10.0]
    assert field.encode(np.array([[9e9, -9e9, 0.0]])).tolist() == [[2047, 0, -2048]]


def test_the_chips_own_trim_is_in_the_order_of_the_registers():
    out = Register(0x03, access='ro', size=6, reset=None)
    field = Vector(
        first=out,
        quantity='magnetic_field',
        unit='T',
        dtype='<i2',
        si_per_lsb=1.0,
        axes=((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    )
    trim = np.array([2.0, 1.0, 0.5])
    si = field.decode(np.array([[10, 20, 30]]), trim=trim)
    assert si.tolist() == [[20.0, 20.0, -15.0]]
    assert field.encode(si, trim=trim).tolist() == [[10, 20, 30]]


def test_a_chip_may_send_floats():
    out = Register(0x4020, access='ro', size=12, addresses=1, reset=None)
    rate = Vector(
        first=out, quantity='angular_velocity', unit='rad/s', dtype='>f4', si_per_lsb=1.0
    )
    si = np.array([[0.1, -1e6, 3.0]])
    np.testing.assert_allclose(rate.decode(rate.encode(si)), si, rtol=1e-7)
    assert not rate.saturated(rate.encode(si)).any()


@pytest.mark.parametrize(
    'changes',
    [
        {'dtype': '<i4'},
        {'si_per_lsb': {2: 1.0}},
        {'si_per_lsb': 1.0},
        {'scaled_by': None},
        {'axes': ((1, 0, 0), (1, 0, 0), (0, 0, 1))},
        {'axes': ((1, 0, 0), (0, 2, 0), (0, 0, 1))},
    ],
)
def test_wrong_channels_are_refused(changes):
    good = {
        'first': Chip.OUT,
        'quantity': 'acceleration',
        'unit': 'm/s²',
        'dtype': '<i2',
        'scaled_by': Chip.scale,
        'si_per_lsb': {2: 1.0, 4: 2.0, 8: 4.0, 16: 12.0},
    }
    Vector(**good)
    with pytest.raises(ConfigError):
        Vector(**good | changes)


def test_a_frame_takes_a_burst_apart_and_puts_it_together():
    temperature = Scalar(
        first=Register(0x15, access='ro', size=2, reset=None),
        quantity='temperature',
        unit='°C',
        dtype='>i2',
        si_per_lsb=0.5,
        offset=25.0,
    )
    burst = Frame(Chip.STATUS, Chip.acceleration, temperature)
    data = bytes.fromhex('80 1000 2000 3000 000a') * 2
    words = burst.unpack(data)
    assert burst.size == 9
    assert words['STATUS'].tolist() == [0x80, 0x80]
    assert words['acceleration'][1].tolist() == [16, 32, 48]
    assert temperature.decode(words['temperature']).tolist() == [30.0, 30.0]
    assert burst.pack({name: words[name] for name in words.dtype.names}, 2) == data
