# SPDX-License-Identifier: Apache-2.0
"""Findings about stamps and numbers of samples: gaps, order, jitter, losses, the clock."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imu_bench.account import Border, CHIP, DISK, QUEUE, TRANSPORT
from imu_bench.bags.problems import (
    code_of,
    COUNTS,
    FLOODED,
    FOREIGN,
    INCOMPLETE,
    NOT_A_NUMBER,
    Problem,
    PUBLISHERS,
    RECORDERS,
    REMARK,
    SIMULATED,
    STAMPS,
)
from imu_bench.counting import grouped
from imu_bench.metrology.stamps.timing import Timing
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.notation import count, duration, number, percent, text
from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.delivery import Delivery
from imu_bench.offline.recordings.sifting import OUTER
import numpy as np

# share of the true time grid: where a share p is lost at random, half of the differences over
# windows of ln 2 / 2p samples are complete, 350 and 7 of them
_FEW_MISSING, _MANY_MISSING = 1e-3, 0.05
# of the sample period: a tone at half the rate keeps e^(−(πσ)²/2) of its amplitude, 95 % and 29 %
_JITTER, _HEAVY_JITTER = 0.1, 0.5
_SCATTERED = 10  # gaps: fewer leave a stretch of a tenth of the recording
_SHORT_S = 60.0  # averaging times end at 20 s: bias instability shows beyond 10 s at the earliest
_CLOCK_OFFSET_S = 1.0  # more than any transport takes: the clocks differ
_LOOKED_AT = 1 << 20  # samples: medians of more are no better
_CLOCK_DRIFT = 100e-6  # a crystal is good to 50 ppm; two of them differ by less than this


def timing_findings(timing: Timing, origin_ns: int) -> Iterator[Finding]:
    """Yield what the stamps say about gaps, duplicates, order, jitter and length."""
    if timing.gaps:
        share = timing.missing / (timing.missing + timing.samples)
        severe, some = share > _MANY_MISSING, share > _FEW_MISSING
        scattered = timing.gap_count >= _SCATTERED and not severe
        longest = max(timing.gaps, key=lambda gap: gap.duration_s)
        yield Finding(
            'severe' if severe else 'warning' if some else 'info',
            'gaps',
            f'{count(timing.gap_count, "gap")}, {count(timing.missing, "sample")} missing '
            f'({percent(share)}); the longest lasts {duration(longest.duration_s)} at '
            f't = {duration((longest.start_ns - origin_ns) * 1e-9)}.',
            'Unless asked otherwise, only complete windows are used, so nothing is biased; long '
            'averaging times have '
            'wider intervals' + (', and the longest are lost.' if scattered else '.'),
            'Look for an overloaded bus, network or disk; record again if the gaps are not rare'
            + ('; --min-share 0.95 lets averages lack a few samples.' if scattered else '.'),
        )
    if timing.duplicates:
        share = timing.duplicates / timing.samples
        yield Finding(
            'warning' if share > _FEW_MISSING else 'info',
            'duplicates',
            f'{count(timing.duplicates, "stamp")} ({percent(share)}) equal to the one before.',
            'All but the first of each are left out of the analysis.',
            'Check that the driver stamps every sample, not every transfer.',
        )
    if timing.order_faults:
        yield Finding(
            'warning',
            'order',
            f'{count(timing.order_faults, "step")} back in time.',
            'These samples are left out; if the clock was set during the test, what follows is '
            'shifted.',
            'Use a monotonic clock for stamps, and switch off time synchronisation jumps.',
        )
    yield from _regularity(timing)


def _regularity(timing: Timing) -> Iterator[Finding]:
    jitter = (timing.jitter.value or 0.0) / timing.period_s
    if jitter > _JITTER:
        yield Finding(
            'severe' if jitter > _HEAVY_JITTER else 'warning',
            'jitter',
            f'Sample intervals scatter by {text(timing.jitter)}, {percent(jitter)} of the period.',
            'The samples are placed on a regular grid: Allan deviations hold, but tones and the '
            'upper end of the spectrum are smeared.',
            'Stamp where the sample is taken (data-ready interrupt, FIFO count), not on arrival.',
        )
    if timing.duration_s < _SHORT_S:
        yield Finding(
            'info',
            'short',
            f'The recording lasts {duration(timing.duration_s)}.',
            f'Averaging times end at {duration(timing.duration_s / 3.0)}: bias instability and '
            'rate random walk cannot be seen.',
            'Record at least 20 minutes for the noise density, several hours for B and K.',
        )


def clock_findings(recording: Recording) -> Iterator[Finding]:
    """Yield which stamps were used and how the sensor's clock compares with the recorder's."""
    if recording.stamp_source == 'receive':
        yield Finding(
            'warning',
            'stamps',
            f'The receive time is used because {recording.stamp_reason}.',
            'Delays of the transport appear as jitter, and the rate is that of the arrival.',
            'Make the driver fill header.stamp with the time of measurement.',
        )
    stamps, received = recording.samples.stamps, recording.receive_ns
    if recording.stamp_source not in ('header', OUTER) or received is None or stamps.size < 3:
        return
    apart = slice(None, None, max(1, stamps.size // _LOOKED_AT))
    delay = (received[apart] - stamps[apart]) * 1e-9
    span = (stamps[-1] - stamps[0]) * 1e-9
    if abs(typical := float(np.median(delay))) > _CLOCK_OFFSET_S:
        direction = 'behind' if typical > 0 else 'ahead of'
        yield Finding(
            'info',
            'clock_offset',
            f'Header stamps are {duration(abs(typical))} {direction} the receive time.',
            'None on noise: only differences of stamps are used. Sensors of different clocks do '
            'not line up.',
            'Synchronise the clocks (chrony, PTP) before comparing several sensors in time.',
        )
    edge = max(1, delay.size // 10)
    drift = float(np.median(delay[-edge:]) - np.median(delay[:edge])) / max(0.9 * span, 1e-9)
    scatter = float(np.std(delay[:edge])) / max(0.9 * span, 1e-9)
    if span > _SHORT_S and abs(drift) > max(_CLOCK_DRIFT, 3.0 * scatter):
        yield Finding(
            'info',
            'clock_drift',
            f'Header stamps and receive time drift apart by {number(drift * 1e6, 3)} ppm.',
            'The rate, and every coefficient per time, is uncertain by that much at most.',
            'Check which of the two clocks is disciplined.',
        )


_ELSEWHERE = (COUNTS, STAMPS, NOT_A_NUMBER)  # codes of notes that are findings of their own


def reading_findings(recording: Recording, problems: Sequence[str]) -> Iterator[Finding]:
    """Yield what happened while a recording was read."""
    for words in problems:
        own = isinstance(words, Problem) and words.topic == recording.topic
        if not (own and code_of(words) == COUNTS):  # compared below
            yield _remark(words)
    for words in recording.notes:
        if code_of(words) == RECORDERS:
            yield _two_recorders(words, recording.delivery)
        elif code_of(words) not in _ELSEWHERE:
            yield _remark(words)
    yield from _counts(recording)
    yield from _left_out(recording)


def simulation_finding(words: str) -> Finding:
    """Return that nothing measured the samples."""
    return Finding(
        'info',
        SIMULATED,
        f'{words[:1].upper()}{words[1:].rstrip(".")}.',
        'The numbers say what went into the simulation, not what a sensor does.',
        'Learn the tool with it; to choose a sensor or to set a filter, record the real one.',
    )


def _remark(words: str) -> Finding:
    if code_of(words) == INCOMPLETE:
        return Finding(
            'warning',
            INCOMPLETE,
            f'{words}.',
            'The numbers describe the part that could be read.',
            'Check that the recorder was stopped properly, and the disk it wrote to.',
        )
    if code_of(words) == SIMULATED:
        return simulation_finding(words)
    if code_of(words) == FOREIGN:
        return Finding(
            'info',
            FOREIGN,
            f'{words[:1].upper()}{words[1:]}.',
            'It stands apart from the sensors, and is compared with none.',
            'Find out who published it; --topic analyses it like a sensor.',
        )
    if code_of(words) == PUBLISHERS:
        return Finding(
            'severe',
            PUBLISHERS,
            f'{words}.',
            'What is in the recording need not be what the sensor measured: it is no evidence.',
            'End the others, or find out who they are, and record again; by itself imu-bench '
            'keeps a bench to this machine.',
        )
    if code_of(words) == FLOODED:
        return Finding(
            'warning',
            FLOODED,
            f'{words}.',
            'None on the samples; what the nodes said of them may be incomplete.',
            'Find out who publishes so much on /diagnostics.',
        )
    return Finding(
        'info',
        REMARK,
        f'{words}.',
        'None, if this is what you expect.',
        'Check how the recording was made, and the options.',
    )


def _two_recorders(words: str, delivery: Delivery | None) -> Finding:
    whole = ''
    if delivery is not None and delivery.whole:
        sent = grouped(delivery.published)
        whole = f'; the samples themselves are whole: {sent} of {sent} messages are here'
    return Finding(
        'severe',
        RECORDERS,
        f'{words}{whole}.',
        'The bench was not alone: two bags claim to be the recording, the machine had both to '
        'carry, and who asks something of the recorder asks either of them.',
        'Record a bench once, and give a second one a ROS_DOMAIN_ID of its own.',
    )


def _counts(recording: Recording) -> Iterator[Finding]:
    announced, stored = recording.announced, recording.stored
    if announced is None or announced == stored:
        return
    lost = abs(announced - stored) / max(announced, stored)
    yield Finding(
        'severe' if lost > _MANY_MISSING else 'warning',
        COUNTS,
        f'The metadata announces {count(announced, "message")}, {stored} were read.',
        'Metadata and storage disagree: messages may be missing at the end or in between.',
        'Compare with the original recording; do not use it as evidence of a data rate.',
    )


def _left_out(recording: Recording) -> Iterator[Finding]:
    if not recording.left_out:
        return
    details = '; '.join(note for note in recording.notes if code_of(note) == NOT_A_NUMBER)
    share = recording.left_out / max(recording.stored, 1)
    yield Finding(
        'severe' if share > _MANY_MISSING else 'warning',
        NOT_A_NUMBER,
        f'{count(recording.left_out, "sample")} ({percent(share)}) hold NaN or infinite '
        f'values{f": {details}" if details else ""}.',
        'They are left out and treated as gaps; nothing is averaged over them.',
        'Look for read errors or a division by zero in the driver.',
    )


_EFFECT = (
    'They are gaps: only complete windows are used, long averaging times have wider intervals.'
)


def delivery_findings(delivery: Delivery | None, origin_ns: int) -> Iterator[Finding]:
    """Yield what was lost at which border, by what sensor and recorder said in the bag."""
    if delivery is None:
        return
    yield from _lost(delivery, CHIP, 'lost_in_sensor', delivery.sensor, 'sample')
    if delivery.scripted:
        yield Finding(
            'info',
            'lost_to_faults',
            f'{count(delivery.scripted, "sample")} lost to scripted faults.',
            _EFFECT,
            'None: the faults were asked for.',
            delivery.scripted,
            'scripted faults',
        )
    yield from _lost(delivery, QUEUE, 'lost_before_publishing', delivery.queue, 'sample')
    where = _where(delivery, origin_ns)
    on_the_way = delivery.missing - min(delivery.disk, delivery.missing)
    yield from _lost(delivery, TRANSPORT, 'lost_on_the_way', on_the_way, 'message', where)
    yield from _lost(delivery, DISK, 'lost_at_disk', delivery.disk, 'message')
    if delivery.unclear:
        yield Finding(
            'info',
            'published_before',
            f'{count(delivery.unclear, "message")} published before the first status of the '
            'sensor in this recording, and not in it.',
            'None, if the recording began after the sensor.',
            'To have every sample, start the recorder first; ours says what it has missed.',
            delivery.unclear,
            'before the recording',
        )
    if delivery.restarts:
        yield Finding(
            'warning',
            'restarted',
            f'The sensor was started again {count(delivery.restarts, "time")}.',
            'What it would have measured meanwhile was never read, and is in no count.',
            'Read the log of its process.',
            delivery.restarts,
            '',
        )


def _lost(
    delivery: Delivery, border: Border, code: str, number: int, what: str, where: str = ''
) -> Iterator[Finding]:
    if not number:
        return
    whole = delivery.published + (number if border in (CHIP, QUEUE) else 0)
    share = number / whole
    lost = f'{count(number, what)} of {grouped(whole)} lost {border.where}'
    yield Finding(
        'severe' if share > _MANY_MISSING else 'warning',
        code,
        f'{lost} ({percent(share)}){where}.',
        _EFFECT,
        f'{border.advice[0].upper()}{border.advice[1:]}.',
        number,
        border.short,
    )


def _where(delivery: Delivery, origin_ns: int) -> str:
    """Say when messages are missing."""
    parts = [
        f'{grouped(stretch.missing)} between {_time(stretch.start_ns - origin_ns)} and '
        f'{_time(stretch.end_ns - origin_ns)}'
        for stretch in delivery.worst
    ]
    if delivery.at_end:
        parts.append(f'{grouped(delivery.at_end)} behind the last message that is there')
    return f': {"; ".join(parts)}' if parts else ''


def _time(ns: int) -> str:
    return duration(max(0.0, ns * 1e-9)) if ns else '0 s'
