# SPDX-License-Identifier: Apache-2.0
"""Which topics that others publish are recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import time
from typing import NamedTuple

from imu_bench.bags.topic_info import meant
from imu_bench.errors import NotReady
from imu_bench.nodes.topic_names import DIAGNOSTICS, IMU_TYPE, SUFFIXES

WITHIN_S = 10.0
"""How long somebody may take to publish; nodes on other machines are found within 3 s."""

SETTLED_S = 1.5
"""When no topic has come for so long, all are known."""

LOOK_S = 0.1

NEIGHBOURS = ('sensor_msgs/msg/MagneticField', 'sensor_msgs/msg/Temperature')


class Topics(NamedTuple):
    """The topics that count, and all that are recorded."""

    main: tuple[str, ...]
    recorded: tuple[str, ...]


def await_topics(
    graph: Callable[[], Mapping[str, str]], wanted: Sequence[str], ask: Callable[[], None]
) -> Topics:
    """Wait until there is something to record."""
    began = changed = time.monotonic()
    found: Mapping[str, str] = {}
    while True:
        ask()
        now, seen = time.monotonic(), graph()
        if seen != found:
            found, changed = seen, now
        imus, settled = _imus(found), now - changed > SETTLED_S
        names = [_full(name, found, imus if settled else ()) for name in wanted]
        if names and all(names):
            every = tuple(dict.fromkeys(names))
            return Topics(every, every)
        if imus and not names and settled:
            return Topics(imus, (*imus, *_neighbours(found)))
        if now - began > WITHIN_S + SETTLED_S:
            lost = [name for name, topic in zip(wanted, names, strict=True) if not topic]
            raise NotReady(_nobody(lost, found))
        # the pace of looking: the graph tells nobody that it has changed
        time.sleep(LOOK_S)


def _full(name: str, graph: Mapping[str, str], imus: Sequence[str]) -> str:
    """Return the topic that a name stands for: a short one is that of one Imu topic alone."""
    found = meant(name, graph) if '/' + name.lstrip('/') in graph else meant(name, imus)
    return found[0] if len(found) == 1 else ''


def _imus(graph: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(name for name, kind in graph.items() if kind == IMU_TYPE)


def _neighbours(graph: Mapping[str, str]) -> Iterable[str]:
    """Return what is recorded beside Imu topics: as the recorder does, and the same by type."""
    ends = tuple(f'/{suffix}' for suffix in SUFFIXES)
    for name, kind in graph.items():
        known = kind in NEIGHBOURS or name == DIAGNOSTICS or name.endswith(ends)
        if known and kind != IMU_TYPE:
            yield name


def _nobody(names: Sequence[str], graph: Mapping[str, str]) -> str:
    there = ', '.join(_imus(graph)) or 'none'
    if names:
        lost = ', '.join(names)
        return f'{lost}: nobody publishes this after {WITHIN_S:g} s; Imu topics: {there}'
    return (
        f'nobody publishes an Imu topic after {WITHIN_S:g} s; start a driver, check '
        'ROS_DOMAIN_ID, or name a bench to start its sensors'
    )
