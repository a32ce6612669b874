# SPDX-License-Identifier: Apache-2.0
"""Threads that go first, as far as the operating system lets them."""

from collections import Counter
import os
import threading

from imu_bench.acquisition import Acquisition, priority
from imu_bench.bus.clock import SystemClock
import pytest


@pytest.fixture
def granted(monkeypatch):
    """Record what is asked of the operating system; refuse what is named."""
    asked = {'refused': set()}

    def scheduler(pid, policy, parameters):
        if 'real time' in asked['refused']:
            raise PermissionError(1, 'Operation not permitted')
        asked['scheduler'] = pid, policy & os.SCHED_FIFO, parameters.sched_priority
        asked['heirs'] = not policy & os.SCHED_RESET_ON_FORK

    def nice(which, who, value):
        if 'nice' in asked['refused']:
            raise PermissionError(13, 'Permission denied')
        asked['nice'] = which, who, value

    monkeypatch.setattr(os, 'sched_setscheduler', scheduler)
    monkeypatch.setattr(os, 'setpriority', nice)
    return asked


def test_real_time_if_it_may(granted):
    assert priority.raise_priority() == 'real time, priority 10'
    assert granted['scheduler'] == (0, os.SCHED_FIFO, 10)
    # neither a thread of the middleware nor a process may inherit it
    assert not granted['heirs']


def test_a_better_nice_value_of_this_thread_alone_if_not(granted):
    granted['refused'] = {'real time'}
    assert priority.raise_priority() == 'nice -10'
    assert granted['nice'] == (os.PRIO_PROCESS, threading.get_native_id(), -10)


def test_nothing_and_no_error_if_it_may_not(granted):
    granted['refused'] = {'real time', 'nice'}
    assert priority.raise_priority().startswith('ordinary')


def test_whether_it_may_is_found_out_without_changing_the_caller():
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    assert priority.permitted()
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before


def test_an_acquisition_says_how_its_thread_is_treated(granted):
    class Silent:
        counters, rates_hz, skipped, continuity, dated = Counter(bus_errors=0), {}, {}, 0, True
        edge = latch_ns = None
        rate_hz, poll_period_s, paced = 100.0, 0.001, False

        def identify(self):
            read.set()
            return 'part'

        def read(self):
            return []

        configure = start = stop = close = lambda self: None

    read = threading.Event()
    acquisition = Acquisition(Silent(), SystemClock())
    assert acquisition.stats.scheduling == ''
    acquisition.start()
    read.wait()
    assert acquisition.stats.scheduling == 'real time, priority 10'
    acquisition.close()
