# SPDX-License-Identifier: Apache-2.0
"""What came of a recording: a line for each sensor or topic, and everything that is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from imu_bench.account import Account, advice, MISSED, topic
from imu_bench.bags import metadata
from imu_bench.counting import count, grouped
from imu_bench.errors import RecordingError
from imu_bench.offline.notation import duration
from imu_bench.recording.place import size, stored_bytes
from imu_bench.recording.showing import LISTED

if TYPE_CHECKING:
    from imu_bench.live.views import RecorderView, SensorView
    from imu_bench.recording.rows import Verdict
    from imu_bench.recording.showing import Showing


class Judgement:
    """
    A recording that is over, and the one verdict on it.

    Parameters
    ----------
    sensors : mapping of str to SensorView
        By the name of the sensor.
    recorder : RecorderView
        What both said to their last.
    showing : Showing
        What was shown of it.
    ended_s : float
        When it ended, on the clock of `time.monotonic`.
    asked : str
        The signal that ended it; empty if none did.
    killed : sequence of str
        Processes that did not end when they were told to.
    """

    def __init__(
        self,
        bag: Path,
        sensors: Mapping[str, SensorView],
        recorder: RecorderView,
        showing: Showing,
        ended_s: float,
        asked: str,
        killed: Sequence[str] = (),
    ) -> None:
        self.bag, self.asked, self.sensors = bag, asked, sensors
        self.stored = stored_in(bag)  # messages of the bag by topic; None if it was not finished
        self._recorder, self._showing, self._ended_s = recorder, showing, ended_s
        self._killed = killed

    @property
    def _comparable(self) -> Mapping[str, int] | None:
        """What is stored, if it can be held against what was published in the end."""
        return None if self._showing.recorder_ended else self.stored

    @cached_property
    def _verdicts(self) -> list[Verdict]:
        return [
            row.verdict(self.stored, row.account(self._comparable), self._ended_s)
            for row in self._showing.rows
        ]

    @cached_property
    def _others(self) -> list[Account]:
        """Accounts of recorded topics that are in no row and lack something."""
        shown = {topic.name for verdict in self._verdicts for topic in verdict.account.topics}
        counts = self._recorder.counts
        names = [key.removeprefix(MISSED) for key in counts if key.startswith(MISSED)]
        accounts = [
            Account(name, topics=(topic(name, counts, self._comparable),))
            for name in names
            if name not in shown
        ]
        return [account for account in accounts if account.lost]

    @property
    def lines(self) -> list[str]:
        """A line for each row, for each other topic that lacks something, and what to do."""
        verdicts = [verdict.line for verdict in self._verdicts]
        others = [f'{account.name}: {account.words}' for account in self._others]
        accounts = [*(verdict.account for verdict in self._verdicts), *self._others]
        flooded = [self._recorder.flooded] if self._recorder.flooded else []
        return [*verdicts, *others, *advice(accounts), *flooded, *self._beside]

    @property
    def _beside(self) -> list[str]:
        """What there is of others, under a heading of its own."""
        left_out, away = self._recorder.beside, self._recorder.turned_away
        if not left_out:
            return []
        stored = self.stored or {name: self._recorder.stored(name) for name in left_out}
        lines = []
        for name, left in sorted(left_out.items()):
            more = f', {grouped(left)} left out' if left else ''
            lines.append(f'  {name}: {count(stored.get(name, 0), "message")}{more}')
        more_topics = [f'  {count(away, "more topic")}, not recorded'] if away else []
        several = count(len(left_out) - LISTED, 'more topic')
        shown = lines[:LISTED] + ([f'  {several}'] if len(lines) > LISTED else [])
        return ['recorded as well, of others:', *shown, *more_topics]

    @property
    def faults(self) -> list[str]:
        """Everything that is wrong, nothing if all is well."""
        faults = [self._showing.failure] if self._showing.failure else []
        faults += [fault for verdict in self._verdicts for fault in verdict.faults]
        faults += [f'{each.name}: {fault}' for each in self._others for fault in each.faults]
        faults += [
            f'{name} ended by itself and was started again {count(times, "time")}'
            for name, times in self._showing.restarts.items()
        ]
        if self._recorder.dropped and not self._showing.failure:
            dropped = count(self._recorder.dropped, 'message')
            faults.append(f'{dropped} dropped: the disk is too slow')
        faults += [
            f'{name} did not stop and was killed: what it held is not in the bag'
            for name in self._killed
        ]
        faults += self._recorder.several
        faults += [self._recorder.others] if self._recorder.two_of_ours else []
        if self.stored is None:
            faults.append('the bag was not finished, analyze reads it as it is')
        return faults

    def total(self, wanted_s: float | None) -> str:
        """Return what there is in the bag; `wanted_s` is how long it should have taken."""
        messages = 'not finished'
        if self.stored is not None:
            messages = count(sum(self.stored.values()), 'message')
        ran = duration(round(self._showing.ran_s, 1))
        if wanted_s is not None and self.asked:
            ran += f' of {duration(wanted_s)}, stopped by {self.asked}'
        return f'{self.bag}: {messages}, {size(stored_bytes(self.bag))}, {ran}'


def stored_in(bag: Path) -> dict[str, int] | None:
    """Return the messages of a bag by topic; None if it was not finished."""
    try:
        return metadata.read(bag / metadata.FILE_NAME).counts
    except (OSError, RecordingError):
        return None
