# SPDX-License-Identifier: Apache-2.0
"""Findings about samples that the sensor counted and the recording lacks, border by border."""

from __future__ import annotations

from collections.abc import Iterator

from imu_bench.account import Border, CHIP, DISK, QUEUE, TRANSPORT
from imu_bench.counting import count, grouped
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.notation import duration, percent
from imu_bench.offline.recordings.delivery import Delivery

_SEVERE = 0.05  # share lost, as `stamps._MANY_MISSING`
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
        'severe' if share > _SEVERE else 'warning',
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
