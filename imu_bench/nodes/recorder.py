# SPDX-License-Identifier: Apache-2.0
"""The recorder: everything the bench says, as it was said, into a bag of rosbag2."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from datetime import datetime
import math
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench.account import (
    BENCH,
    BESIDE,
    flooded,
    FOREIGN,
    LEFT_OUT,
    own_topics,
    RECORDERS,
    SECOND,
    SEVERAL,
    several,
    several_record,
    STORED,
    TURNED_AWAY,
)
from imu_bench.bags.background import BackgroundWriter
from imu_bench.bags.topic_info import describe, INFINITE_NS, OfferedQos
from imu_bench.bags.writer import BagWriter
from imu_bench.config import Setting
from imu_bench.config.bench import RECORDER_SETTINGS
from imu_bench.errors import RecordingError
from imu_bench.nodes import diagnostics, discovery, network, parameters
from imu_bench.nodes.discovery import message_class
from imu_bench.nodes.intake import Intake
from imu_bench.nodes.others import Others, recorders, UNNAMED
from imu_bench.nodes.topic_names import DIAGNOSTICS, MEASURED, SUFFIXES
from msg_conversions import building
from msg_conversions.diagnostics import TYPE as DIAGNOSTICS_TYPE
from msg_conversions.quantities import LINEAR_ACCELERATION, MAGNETIC_FIELD, TEMPERATURE, TYPES
from msg_conversions.transforms import TF_STATIC, TF_TYPE
import numpy as np
import numpy.typing as npt
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import Imu

SETTINGS = (
    Setting(
        'output', '', 'Folder of the bag; must not exist. Named after the time when not given.'
    ),
    *RECORDER_SETTINGS,
    Setting(
        'topics',
        (),
        "Names of the topics to record; when none is given, the bench's own of every namespace.",
        kind='strs',
    ),
    Setting('all_topics', False, 'Record every topic there is.'),
    Setting(
        'sensors',
        (),
        'Namespaces of sensors that come up later: what these measure is recorded from their own '
        'nodes alone, whoever else publishes it; what others measure is recorded beside it.',
        kind='strs',
    ),
    Setting(
        'max_bytes',
        0,
        'Size at which the next file of the bag begins; 0 for one file.',
        bounds=(0, 2**62),
        unit='B',
    ),
)

LOOK_S = 0.25
"""Seconds between two looks at the graph."""

NAMED_AFTER = 4
"""Looks after which a publisher whose node is not known has none."""

ENDS = tuple(f'/{end}' for end in SUFFIXES)

MEASUREMENTS = frozenset(
    q.message.type for q in (LINEAR_ACCELERATION, MAGNETIC_FIELD, TEMPERATURE)
)
"""Types of topics that one sensor publishes, whatever their names."""


class RecorderNode(parameters.FromDump):
    """
    Records topics into a bag; the messages stay the bytes that came over the wire.

    Topics may come and go.  One thread takes what has come, another writes and flushes at least
    once a second, so that a killed recorder loses no more than that second.  What publishers
    have sent and the bag does not hold is counted.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            'recorder', automatically_declare_parameters_from_overrides=True, **options
        )
        untyped: Any = self  # rclpy of Jazzy has few type hints
        self.log = untyped.get_logger()
        settings = parameters.read(self, SETTINGS)
        self._only = {self.resolve_topic_name(name) for name in settings['topics']}
        self._all = settings['all_topics']
        self._alone = own_topics(settings['sensors'], MEASURED)
        self._own = own_topics(settings['sensors'], SUFFIXES) - self._only
        self._types = {DIAGNOSTICS: DIAGNOSTICS_TYPE, TF_STATIC: TF_TYPE} | {
            f'{space}/{end}': kind for space in settings['sensors'] for end, kind in TYPES.items()
        }
        self._several: dict[str, str] = {}
        self._recorders = self._second = ''
        self._unnamed: Counter[str] = Counter()
        self._foreign: dict[str, int] = {}
        self.path = Path(settings['output'] or f'imu_bench_{datetime.now():%Y_%m_%d-%H_%M_%S}')
        bounded = () if self._all or self._only else settings['sensors']
        self._others = Others(bounded, str(self.path))
        self._known: set[str] = set()
        self._of_one: dict[str, type] = {}
        self._writer = BackgroundWriter(
            BagWriter(
                self.path,
                settings['storage'],
                max_bytes=settings['max_bytes'],
                custom={
                    'network': network.words(),
                    **({BENCH: ' '.join(settings['sensors'])} if settings['sensors'] else {}),
                },
            )
        )
        self._look_s = -math.inf
        self._intake = Intake(self, self._wants, self._store, self._tend)
        # done with the RecordingError when the disk is full or fails
        self.ended = self._intake.ended
        self._diagnostics = diagnostics.Diagnostics(self, self._statuses)
        self.log.info(f'recording into {self.path.resolve()}')
        self._intake.start()

    @property
    def received(self) -> Counter[str]:
        """Messages taken, by topic."""
        sequences = self._intake.sequences.copy()
        return Counter({name: each.received for name, each in sequences.items()})

    def close(self) -> None:
        """Write everything that has been sent, finish the bag, and say how it went."""
        self._intake.close(linger=self._writer.error is None)
        try:
            self._finish()
        finally:
            if self.context.ok():
                self._diagnostics.last_words()

    def _finish(self) -> None:
        told = self._writer.error is not None
        try:
            self._writer.close()
        except RecordingError as problem:
            if not told:
                self.log.fatal(str(problem))
            return
        total = sum(self._writer.counts.values())
        self.log.info(f'{total} messages on {len(self._writer.counts)} topics in {self.path}')

    # --- topics ------------------------------------------------------------------------

    def _tend(self) -> None:
        """Follow what is new; stop when the bag cannot be written any more."""
        if self._writer.error is not None:
            raise self._writer.error
        now = time.monotonic()
        if now - self._look_s < LOOK_S:
            return
        self._look_s = now
        for name, kind in discovery.find(self, known=self._types).items():
            if name not in self._known and (self._wants(name) or self._lets_in(name, kind)):
                publishers = discovery.publishers(self, name, kind)
                if name in self._alone and not self._intake.carrier(name, publishers):
                    continue
                if publishers:
                    self._known.add(name)
                    self._follow(name, kind, publishers)
        for name, message in self._of_one.items():
            self._look_for_others(name, message)

    def _look_for_others(self, name: str, message: type) -> None:
        """Take note of who else publishes a topic; once seen it stays a fault."""
        names, foreign = self._intake.several(name, message)
        self._foreign[name] = foreign
        # the graph knows a publisher a moment before it knows his node
        self._unnamed[name] += UNNAMED in names
        if UNNAMED in names and self._unnamed[name] < NAMED_AFTER:
            return
        if names and name not in self._several:
            self._several[name] = ', '.join(names)
            self.log.error(several(name, self._several[name]))
            self._diagnostics.publish_soon()

    def _look_for_recorders(self) -> None:
        """Take note of who else records the same; once seen it stays known."""
        if not self._recorders:
            imus = [name for name, message in self._of_one.copy().items() if message is Imu]
            found = recorders(each for name in imus for each in self._intake.listeners(name))
            self._recorders = ', '.join(found) if len(found) > 1 else ''
        # one that was killed stays in the graph for a while: what speaks is there
        if self._recorders and self._second != self._others.bag:
            self._second = self._others.bag
            self.log.error(several_record(self._recorders, self._second))

    def _wants(self, name: str) -> bool:
        if discovery.hidden(name):
            return False
        if self._all or self._only:
            return self._all or name in self._only
        if name in (DIAGNOSTICS, TF_STATIC):
            return True
        return name in self._own if self._own else name.endswith(ENDS)

    def _lets_in(self, name: str, kind: str) -> bool:
        """Return whether a topic of others is recorded beside those of the bench."""
        if not self._own or self._only or kind not in MEASUREMENTS or discovery.hidden(name):
            return False
        return self._others.lets_in(name)

    def _store(
        self, topic: str, stamps: npt.NDArray[np.int64], rows: npt.NDArray[np.uint8]
    ) -> None:
        """Write messages; of others no more than there is of the bench."""
        if topic in self._others.beside:
            fitting = self._others.fitting(topic, rows)
            stamps, rows = stamps[:fitting], rows[:fitting]
        elif topic == DIAGNOSTICS:
            kept = self._others.recordable(rows)
            stamps, rows = stamps[kept], rows[kept]
        elif topic in self._own:
            self._others.note_own(rows.nbytes)
        if len(rows):
            self._writer.put(topic, stamps, rows)

    def _follow(self, name: str, kind: str, publishers: list[TopicEndpointInfo]) -> None:
        message = message_class(kind)
        if message is None:
            self.log.warning(f'{name} is not recorded: its type {kind} is not installed here')
            return
        # whose places are on /tf_static nobody can tell
        if self._own and (name == TF_STATIC or not self._wants(name)):
            self._others.beside[name] = 0
        offered = [offered_qos(publisher.qos_profile) for publisher in publishers]
        self._writer.add_topic(describe(name, kind, offered, _type_hash(publishers)))
        self._intake.follow(name, message, publishers)
        if name not in self._others.beside and (kind in MEASUREMENTS or name.endswith(ENDS)):
            self._of_one[name] = message

    # --- health ------------------------------------------------------------------------

    def _statuses(self) -> Iterable[DiagnosticStatus]:
        self._look_for_recorders()
        writer, intake = self._writer, self._intake
        stored, sequences = writer.counts, intake.sequences.copy()
        beside, away = self._others.beside.copy(), len(self._others.turned_away)
        left_out = self._others.left_out
        # whose messages never came is not known of topics of many: in a flood, of the flood
        unaccounted = {*beside, *([DIAGNOSTICS] if left_out else [])}
        if left_out:
            left_out += sequences[DIAGNOSTICS].missed
        missed = {
            name: each.missed
            for name, each in sequences.items()
            if each.missed and name not in unaccounted
        }
        dropped = writer.dropped + intake.dropped
        level, line = 'ok', f'recording {len(stored)} topics'
        if left_out:
            level, line = 'warn', flooded(left_out)
        if self._second:
            level, line = 'error', several_record(self._recorders, self._second)
        if self._several:
            level, line = 'error', several(*next(iter(self._several.items())))
        if missed:
            level, line = 'error', f'{sum(missed.values())} messages missed: {", ".join(missed)}'
        if dropped:
            level, line = 'error', f'{dropped} messages dropped: the disk is too slow'
        if intake.damaged:
            level, line = 'error', f'{intake.damaged} blocks of messages damaged'
        if writer.error is not None:
            level, line = 'error', str(writer.error)
        values: dict[str, object] = {
            'bag': self.path,
            'network': network.words(),
            'received': sum(each.received for each in sequences.values()),
            'stored': sum(stored.values()),
            'waiting': writer.waiting,
            'spilled': writer.spilled,
            'dropped': dropped,
            **{STORED + name: count for name, count in stored.items()},
            **{SEVERAL + name: names for name, names in self._several.items()},
            **{FOREIGN + name: count for name, count in self._foreign.items() if count},
            **{BESIDE + name: count for name, count in beside.items()},
            **({TURNED_AWAY: away} if away else {}),
            **({RECORDERS: self._recorders} if self._recorders else {}),
            **({SECOND: self._second} if self._second else {}),
            **({LEFT_OUT: left_out} if left_out else {}),
        }
        for name, each in sequences.items():
            values |= {} if name in unaccounted else each.entries(name)
        name = f'{self.get_name()}: recording'
        return [building.diagnostic_status(name, level, line, str(self.path), values)]


def offered_qos(profile: Any) -> OfferedQos:
    """Return what a publisher offers, in the words of a bag."""
    return OfferedQos(
        history=profile.history.name.lower(),
        depth=profile.depth,
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        deadline_ns=min(profile.deadline.nanoseconds, INFINITE_NS),
        lifespan_ns=min(profile.lifespan.nanoseconds, INFINITE_NS),
        liveliness=profile.liveliness.name.lower(),
        lease_ns=min(profile.liveliness_lease_duration.nanoseconds, INFINITE_NS),
    )


def _type_hash(publishers: list[TopicEndpointInfo]) -> str:
    """Return the hash of the type as the publishers announce it, '' if none does."""
    for publisher in publishers:
        text = str(publisher.topic_type_hash)
        if text.startswith('RIHS'):
            return text
    return ''
