# SPDX-License-Identifier: Apache-2.0
"""What the recordings of the fuzz run hold: a still sensor, and ways to make that impossible."""

from __future__ import annotations

from dataclasses import dataclass
import struct

from msg_conversions import covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np
import numpy.typing as npt

SAMPLES = 300
PERIOD_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000
_YEARS_NS = 3_000_000_000_000_000_000
_STAMP = slice(4, 12)
_FRAME_LENGTH = slice(12, 16)


@dataclass
class Content:
    """
    Samples on their way into a file.

    Attributes
    ----------
    stamps, received : ndarray of int64, shape (n,)
        In ns.
    values : ndarray, shape (n, 6)
        Acceleration and angular velocity in SI.
    blobs : list of bytes
        The same as serialized messages.
    """

    stamps: npt.NDArray[np.int64]
    received: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]
    blobs: list[bytes]


def content(twist: str, rng: np.random.Generator) -> Content:
    """Return samples; twist '' for sound ones, otherwise one of TWISTS."""
    stamps = START_NS + PERIOD_NS * np.arange(SAMPLES)
    received = stamps + rng.integers(0, 100_000, SAMPLES)
    values = rng.normal([0.0, 0.0, 9.8, 0.0, 0.0, 0.0], 0.02, (SAMPLES, 6))
    if twist == 'stamps':
        stamps = _wrong_times(stamps, rng)
        if rng.random() < 0.5:
            received = _wrong_times(received, rng)
    elif twist == 'values':
        _wrong_values(values, rng)
    found = Content(stamps, received, values, _blobs(stamps, values))
    if twist == 'messages':
        _wrong_messages(found.blobs, rng)
    return found


TWISTS = ('stamps', 'values', 'messages')
"""Wrong times, wrong numbers, and messages of wrong length."""


def _blobs(stamps: npt.NDArray[np.int64], values: npt.NDArray[np.float64]) -> list[bytes]:
    template = ImuTemplate(
        'imu_link',
        acceleration_covariance=covariance.UNKNOWN,
        angular_velocity_covariance=covariance.UNKNOWN,
    )
    sound = START_NS + np.zeros(stamps.size, np.int64)
    made = []
    for blob, stamp in zip(
        template.encode_imu(sound, values[:, :3], values[:, 3:]), stamps.tolist(), strict=True
    ):
        seconds, rest = divmod(stamp, 1_000_000_000)
        whole = bytearray(blob)
        # times beyond what a message holds wrap around, as in a careless driver
        whole[_STAMP] = struct.pack('<II', seconds & 0xFFFFFFFF, rest)
        made.append(bytes(whole))
    return made


def _wrong_times(stamps: npt.NDArray[np.int64], rng: np.random.Generator) -> npt.NDArray[np.int64]:
    n, middle = stamps.size, int(rng.integers(1, stamps.size))
    after = np.arange(n) >= middle
    small = np.iinfo(np.int64).min // 4, np.iinfo(np.int64).max // 4
    ways = (
        lambda: np.zeros(n, np.int64),
        lambda: np.full(n, stamps[0]),
        lambda: rng.integers(*small, n),
        lambda: rng.permutation(stamps),
        lambda: stamps[::-1].copy(),
        lambda: stamps + after * _YEARS_NS,
        lambda: stamps - after * _YEARS_NS,
        lambda: stamps[0] + np.arange(n),
        lambda: stamps // (7 * PERIOD_NS) * (7 * PERIOD_NS),
        lambda: stamps - START_NS - middle * PERIOD_NS,
        lambda: np.where(rng.random(n) < 0.05, rng.integers(*small, n), stamps),
        lambda: np.where(rng.random(n) < 0.5, np.roll(stamps, 1), stamps),
        lambda: stamps[0] + np.cumsum(rng.integers(1, 10**10, n)),
        lambda: stamps[0] + PERIOD_NS * np.cumsum(rng.pareto(0.3, n).clip(0, 1e9)).astype(int),
    )
    return np.asarray(ways[int(rng.integers(len(ways)))](), np.int64)


def _wrong_values(values: npt.NDArray[np.float64], rng: np.random.Generator) -> None:
    odd = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-300, 1e20, 9.8)
    for _ in range(int(rng.integers(1, 7))):
        rows = slice(None) if rng.random() < 0.4 else rng.random(len(values)) < rng.random()
        values[rows, int(rng.integers(6))] = rng.choice(odd)


def _wrong_messages(blobs: list[bytes], rng: np.random.Generator) -> None:
    share = rng.choice([0.01, 0.3, 1.0])
    for index in np.flatnonzero(rng.random(len(blobs)) < share).tolist():
        blob = bytearray(blobs[index])
        kind = int(rng.integers(5))
        if kind == 0:
            blob = blob[: int(rng.integers(len(blob)))]
        elif kind == 1:
            blob += bytes(int(rng.integers(1, 400)))
        elif kind == 2:
            blob[_FRAME_LENGTH] = struct.pack('<I', int(rng.choice([0, 1, 7, 2**31, 2**32 - 1])))
        elif kind == 3:
            blob[:4] = rng.bytes(4)
        else:
            for place in rng.integers(len(blob), size=8).tolist():
                blob[place] ^= 1 << int(rng.integers(8))
        blobs[index] = bytes(blob)
