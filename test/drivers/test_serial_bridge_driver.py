# SPDX-License-Identifier: Apache-2.0
"""The serial bridge: lines written by hand, the sketch of the document, what is lost and wrong."""

import os
from pathlib import Path
import re
import shutil
import subprocess

from imu_bench.bus.framing.bridge import BinaryDecoder, SampleCounter, TextDecoder
from imu_bench.bus.scripted import ScriptedStream
from imu_bench.drivers.lsm9ds1 import Lsm9ds1
from imu_bench.drivers.serial_bridge import SerialBridge
from imu_bench.errors import (
    ChecksumError,
    ConfigError,
    FrameError,
    IdentityError,
    NoAnswer,
)
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

DOCUMENT = Path(__file__).parents[2] / 'docs' / 'serial_bridge.md'
SIX = 'n,us,ax,ay,az,gx,gy,gz'
MG, MDPS = 0.732e-3 * 9.80665, 0.07 * np.pi / 180
COUNTS = {'acceleration_unit': MG, 'angular_velocity_unit': MDPS}


def driver(arriving=b'', **settings):
    given = {'rate_hz': 100.0, 'columns': 'n,us,ax,ay,az', 'checked': False} | settings
    made = SerialBridge(ScriptedStream((), arriving), SimulatedClock(), given)
    made.configured = True
    made._heard_ns = made.clock.now_ns()
    made._decoder._begun = True
    return made


def arrive(made, data):
    made._wires['']._arrived += data


def lines(*numbers, period_us=10_000):
    return b''.join(b'%d,%d,%d,0,9.81\n' % (n % 65536, n * period_us, n) for n in numbers)


def frame(content):
    """Return a binary frame, its CRC made bit by bit with the polynomial 0x1021."""
    crc = 0
    for byte in content:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return b'\xa5\x5a' + content + crc.to_bytes(2, 'big')


# --- what is in a line -------------------------------------------------------------------
def test_a_line_written_by_hand():
    made = driver(b'0,0,1,-2,9.81*30\r\n', checked=True)
    [run] = made.read()
    np.testing.assert_array_equal(run.acceleration, [[1.0, -2.0, 9.81]])
    assert made.counters['checksum_errors'] == 0


def test_a_wrong_digit_is_noticed_where_lines_are_checked():
    made = driver(b'0,0,1,-3,9.81*30\n0,0,1,-2,9.81\n0,0,1,-2,9.81*G0\n', checked=True)
    assert made.read() == []
    assert made.counters['checksum_errors'] == 3


def test_the_checksum_is_that_of_nmea_0183():
    # the sentence that Wikipedia and many manuals print
    sentence = b'GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47'
    found = TextDecoder(15, checked=True)
    found._begun = True
    found.feed(sentence + b'\n')
    assert found.checksum_errors == 0
    assert found.garbage > 0  # right, but no numbers


def test_binary_frames_are_checked_by_the_crc_that_everybody_calls_xmodem():
    # its check value: 0x31C3 of the nine characters 123456789
    decoder = BinaryDecoder(['<u1'] * 9)
    found = decoder.feed(b'\x00\xa5\x5a123456789\x31\xc3\xa5')
    assert bytes(found[0].astype(int).tolist()) == b'123456789'
    assert decoder.garbage == 1
    assert len(decoder.feed(b'\x5a123456789\x31\xc2')) == 0
    assert decoder.checksum_errors == 1


def test_a_frame_written_by_hand():
    # 7, 70 000 µs, then -1, 256 and 2
    content = bytes.fromhex('0700 70110100 ffff 0001 0200')
    made = driver(frame(content), format='int16')
    [run] = made.read()
    np.testing.assert_array_equal(run.acceleration, [[-1.0, 256.0, 2.0]])


def test_half_a_line_waits_for_its_other_half():
    made = driver(b'0,0,1,0,9')
    assert made.read() == []
    arrive(made, b'.81\n')
    assert len(made.read()[0]) == 1


def test_what_is_for_people_and_what_is_left_out():
    made = driver(b'# ready\n1,2,3,hot\n', columns='ax,ay,az,-')
    assert made.read() == []
    assert made.counters['garbage_bytes'] == len('1,2,3,hot')
    arrive(made, b'1,2,3,4\n')
    np.testing.assert_array_equal(made.read()[0].acceleration, [[1.0, 2.0, 3.0]])


def test_units_and_what_comes_beside():
    made = driver(
        b'0,0,1000,90,-20,0,2550\n', columns='-,-,gx,gy,gz,-,t',
        angular_velocity_unit=0.001, temperature_unit=0.01,
    )  # fmt: skip
    main, beside = made.read()
    np.testing.assert_allclose(main.angular_velocity, [[1.0, 0.09, -0.02]])
    assert main.acceleration is None
    np.testing.assert_allclose(beside.temperature, [25.5])
    assert made.rates_hz == {'temperature': 100.0}


# --- when it was, and what is missing ----------------------------------------------------
def test_stamps_are_as_far_apart_as_the_clock_of_the_microcontroller_says():
    made = driver(b'0,0,1,0,9\n1,9900,1,0,9\n2,20100,1,0,9\n')
    [run] = made.read()
    assert np.diff(run.stamps).tolist() == [9_900_000, 10_200_000]
    line_ns = round(len('2,20100,1,0,9\n') * 10e9 / 115_200)
    assert run.stamps[-1] == made.clock.now_ns() - line_ns


def test_lines_that_are_missing_are_counted_and_the_run_ends_there():
    made = driver(lines(65534, 65535, 65538, 65539))
    one, two = made.read()
    assert (len(one), len(two)) == (2, 2)
    assert made.skipped == {1: 2}
    assert made.counters['lost_lines'] == 2
    assert made.continuity == 0


@pytest.mark.parametrize(
    ('count', 'us', 'ms', 'missing'),
    [
        ([1, 2, 5], None, None, [0, 0, 2]),
        (None, [2**32 - 10_000, 0, 30_000], None, [0, 0, 2]),
        (None, None, [100, 111, 140], [0, 0, 2]),
        (None, None, None, [0, 0, 0]),
        # it counts what it sends, and its loop was late
        ([1, 2, 3], [100, 10_100, 40_300], None, [0, 0, 2]),
        # late by less than half a period is only late
        ([1, 2, 3], [100, 10_100, 24_000], None, [0, 0, 0]),
        # its clock is 2 % fast, which over 200 samples is four of them
        ([1, 2, 202], [0, 10_000, 2_050_000], None, [0, 0, 199]),
    ],
)
def test_what_is_missing(count, us, ms, missing):
    given = [None if column is None else np.array(column) for column in (count, us, ms)]
    assert SampleCounter(100.0).take(3, *given).missing.tolist() == missing


def test_a_microcontroller_that_begins_anew_is_a_dip_and_a_gap():
    made = driver(lines(500, 501))
    made.read()
    arrive(made, lines(0, 1, 2))
    made.read()
    arrive(made, lines(3, 4))
    assert len(made.read()[0]) == 2
    assert made.counters['brown_outs'] == 1
    assert made.continuity == 1
    assert made.counters['lost_lines'] == 0


def test_full_scale_of_whole_numbers_is_counted():
    # 32767 along x, then a frame whose checksum is wrong
    good, bad = frame(bytes.fromhex('ff7f00000000')), bytes.fromhex('a55a ff7f 0000 0000 0000')
    made = driver(good + bad, format='int16', columns='ax,ay,az')
    assert sum(len(run) for run in made.read()) == 1
    assert made.counters['checksum_errors'] == 1
    assert made.counters['saturated'] == 1


# --- what is wrong -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ('settings', 'text'),
    [
        ({'columns': 'n,ax,ay'}, 'columns: ax, ay, az go together'),
        ({'columns': 'n,t'}, 'columns: neither ax, ay, az nor gx, gy, gz'),
        ({'columns': 'ax,ay,az,volt'}, 'columns: volt; allowed: n, us, ms'),
        ({'columns': 'ax,ay,az,ax'}, 'columns: a column twice'),
        ({'rate_hz': 4000.0}, 'baud: 4000 Hz of 5 columns need .* the line has 115200'),
        ({'rate_hz': 1000.0, 'format': 'float32'}, 'need 220000 baud'),
    ],
)
def test_what_cannot_be_is_refused(settings, text):
    with pytest.raises(ConfigError, match=text):
        driver(**settings)


@pytest.mark.parametrize(
    ('arriving', 'settings', 'error', 'text'),
    [
        (b'', {}, NoAnswer, 'no data for 3 s; check plug, power, and the sketch'),
        (b'\xf0\x80\n\xff\xfe\n', {}, FrameError, r"no lines, but b'\\xff\\xfe'; check baud"),
        (b'x\n1,2,3\n', {}, IdentityError, 'lines of 3 values, expected 5 for columns: n,us,ax'),
        (b'x\n1,2,3,4,5\n', {'checked': True}, ChecksumError, 'set checked: false if the sketch'),
    ],
)
def test_what_comes_instead_is_named(arriving, settings, error, text):
    made = driver(arriving, **settings)
    with pytest.raises(error, match=text):
        made.identify()


def test_silence_is_named():
    made = driver()
    made.clock.sleep(0.2)
    with pytest.raises(NoAnswer, match=r'no data for 0.1 s'):
        made.read()


# --- the sketch of the document ----------------------------------------------------------
SHIM = r"""
#include <cstdint>
#include <cstdio>
#include <cstring>
static uint8_t registers[256], where; static int first; static uint32_t now_us = 4294950000u;
static uint32_t micros() { return now_us; }
struct Line {
  void begin(long baud) { fprintf(stderr, "baud %ld\n", baud); }
  void print(const char *text) { fputs(text, stdout); }
} Serial;
struct Bus {
  void begin() {} void setClock(long) {}
  void beginTransmission(uint8_t chip) { if (chip == 0x6A) first = 1; }
  void write(uint8_t byte) {
    if (first) { where = byte; first = 0; return; }
    fprintf(stderr, "write %d %d\n", where, byte); registers[where++] = byte;
  }
  void endTransmission(bool stop = true) { (void)stop; }
  void requestFrom(uint8_t chip, uint8_t n) { (void)chip; (void)n; }
  uint8_t read() { return registers[where++]; }
} Wire;
"""
MAIN = r"""
static void put(uint8_t place, int value) {
  registers[place] = value & 0xFF; registers[place + 1] = value >> 8 & 0xFF;
}
int main() {
  setup();
  for (int k = 0; k < 40; k++) {
    registers[0x17] = k % 2 ? 3 : k % 4 ? 1 : 2;  /* every second look there is nothing new */
    put(0x28, k); put(0x2A, -k); put(0x2C, 1366);
    put(0x18, -32768); put(0x1A, 0); put(0x1C, 32767);
    now_us += 4202;
    loop();
  }
}
"""


@pytest.fixture(scope='module')
def sketch(tmp_path_factory):
    """Return what the sketch of the document sends, and what it tells its chip."""
    compiler = shutil.which('c++') or shutil.which('g++')
    if compiler is None and not os.environ.get('CI'):
        pytest.skip('no C++ compiler')
    folder = tmp_path_factory.mktemp('sketch')
    [source] = re.findall(r'```cpp\n(.*?)```', DOCUMENT.read_text('utf-8'), re.DOTALL)
    source = source.replace('#include <Wire.h>', '')
    (folder / 'sketch.cpp').write_text(SHIM + source + MAIN)
    flags = ['-std=c++11', '-Wall', '-Wextra', '-Werror', '-fsanitize=undefined,address']
    subprocess.run([compiler, *flags, '-o', folder / 'sketch', folder / 'sketch.cpp'], check=True)
    done = subprocess.run([folder / 'sketch'], check=True, capture_output=True)
    return done.stdout, done.stderr.decode()


def test_the_sketch_is_understood(sketch):
    made = driver(sketch[0], columns=SIX, rate_hz=119.0, checked=True, **COUNTS)
    [run] = made.read()
    assert len(run) == 20
    assert made.counters['checksum_errors'] == made.counters['lost_lines'] == 0
    k = np.arange(1, 40, 2)
    g = 9.80665e-3 * 0.732
    expected = np.column_stack([k * g, -k * g, np.full(20, 1366 * g)])
    np.testing.assert_allclose(run.acceleration, expected, rtol=1e-12)
    turn = np.radians([-32768 * 0.07, 0.0, 32767 * 0.07])
    np.testing.assert_allclose(run.angular_velocity, np.tile(turn, (20, 1)), rtol=1e-12)
    # its clock goes over the end of 32 bits meanwhile
    assert set(np.diff(run.stamps)) == {8_404_000}


def test_the_sketch_sets_its_chip_to_what_the_page_says(sketch):
    written = dict(re.findall(r'write (\d+) (\d+)', sketch[1]))
    gyroscope, accelerometer = int(written['16']), int(written['32'])
    assert Lsm9ds1.CTRL_REG1_G.address == 16
    assert Lsm9ds1.CTRL_REG6_XL.address == 32
    assert Lsm9ds1.gyroscope_range.extract(gyroscope) == 2000.0
    assert Lsm9ds1.accelerometer_range.extract(accelerometer) == 16.0
    assert gyroscope >> 5 == accelerometer >> 5 == 3  # DocID025715, tables 46 and 68: 119 Hz
    assert 'baud 115200' in sketch[1]


def test_the_line_in_the_document_is_one():
    [line] = re.findall(r'One line a sample, `([^`]+)`', DOCUMENT.read_text('utf-8'))
    made = driver(f'{line}\n'.encode(), columns=SIX, checked=True, **COUNTS)
    [run] = made.read()
    assert run.acceleration[0, 2] == pytest.approx(9.81, abs=0.01)
