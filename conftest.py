# SPDX-License-Identifier: Apache-2.0
"""What needs ROS 2 or a library that is not here is skipped and says so; with CI=true it fails."""

from collections import defaultdict
from functools import cache
from importlib.util import find_spec
import os
import re
import subprocess
import sys
import warnings
import zlib

import pytest

OPTIONAL = {
    'allantools', 'backports', 'bokeh', 'colcon_core', 'cyclonedds', 'daqhats', 'distributed',
    'gi', 'grimp', 'importlinter', 'lz4', 'matplotlib', 'mcap', 'mcap_ros2', 'pandas', 'periphery',
    'pypdfium2', 'rosbags', 'sphinx', 'xarray', 'xdist',
}  # fmt: skip
"""What only part of the tests needs and rosdep does not bring everywhere (docs/workspace.md)."""

NEEDS = 'needs {}, which is not installed'

SAID = re.compile(rf"(?:needs|No module named) '?(?:python-)?({'|'.join(sorted(OPTIONAL))})\b")
"""How we and Python say that one is not there."""

HOLDS_TEXT = str, tuple, subprocess.CompletedProcess

IMPORTED = re.compile(r'(?m)^(?:from|import) (\w+)')

OF_ROS = (
    r'(?m)^(from|import) (rclpy|\w+_msgs|std_srvs|builtin_interfaces|imu_bench\.nodes|'
    r'msg_conversions import .*\bbuilding)\b'
)
"""What a file imports that cannot be imported without ROS 2."""


@cache
def missing_ros():
    """Return why what needs ROS 2 cannot run here; empty if it can."""
    with warnings.catch_warnings():
        # the first node or message of rclpy imports a parser that uses a deprecated module
        warnings.simplefilter('ignore', DeprecationWarning)
        try:
            import rosidl_generator_py  # noqa: F401, imported for its warning
        except ModuleNotFoundError as error:
            return f'needs ROS 2 ({error}): source an installation, or pip install .[ros]'
    return ''


def refuse(reason):
    """Skip what is being collected or set up; fail in CI."""
    (pytest.fail if os.environ.get('CI') else pytest.skip)(reason)


@cache
def missing(library):
    """Return whether a library is not installed."""
    return find_spec(library) is None


def missing_for(text):
    """Return why a file of tests or examples cannot be imported; empty if it can."""
    for library in sorted(OPTIONAL.intersection(IMPORTED.findall(text))):
        if missing(library):
            return NEEDS.format(library)
    return missing_ros() if re.search(OF_ROS, text) else ''


class NotImportable(pytest.File):
    """A file that cannot even be imported here."""

    reason = ''

    def collect(self):
        """Say so."""
        refuse(self.reason)


class AskedInVain(set):
    """The last finder of modules: keeps which optional libraries no other has found."""

    def find_spec(self, name, path=None, target=None):
        """Find nothing."""
        self.update(OPTIONAL.intersection(name.split('.')[:1]))


IN_VAIN = AskedInVain()
sys.meta_path.append(IN_VAIN)


def lacking(error, more=()):
    """Return which library an error is about that is not here; empty for other errors."""
    absent = error if isinstance(error, ModuleNotFoundError) else error.__cause__
    name = (getattr(absent, 'name', None) or '').partition('.')[0]
    names = OPTIONAL.intersection([name, *more])
    return next((NEEDS.format(name) for name in sorted(names) if missing(name)), '')


def said(report, traceback):
    """Return which libraries are missed in what a failed test shows and what it holds."""
    texts = [str(report.longrepr), *(text for _, text in report.sections)]
    for entry in traceback:
        held = entry.frame.f_locals.values()
        texts.extend(str(each) for each in held if isinstance(each, HOLDS_TEXT))
    return [name for text in texts for name in SAID.findall(text)]


def stand_in(reason, path, parent):
    """Return what stands in for a file that cannot be imported."""
    instead = NotImportable.from_parent(parent, path=path)
    instead.reason = reason
    return instead


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_pycollect_makemodule(module_path, parent):
    """Be there when the plugin of launch_testing imports every file of tests."""
    try:
        return (yield)
    except Exception as error:  # ours says in a line of its own what it needs
        text = module_path.read_text(encoding='utf-8')
        reason = missing_for(text) or lacking(error, SAID.findall(str(error)))
        if not reason:
            raise
        return stand_in(reason, module_path, parent)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Skip a file that needs, by way of ours, a library that is not here; in CI it fails."""
    report = yield
    names = SAID.findall(str(report.longrepr)) if report.failed else ()
    absent = [name for name in names if missing(name)]
    if absent and not os.environ.get('CI'):
        report.outcome = 'skipped'
        report.longrepr = (str(collector.path), None, f'Skipped: {NEEDS.format(absent[0])}')
        # pytest keeps what it could not import to its end, and the next file would get that
        own = collector.path.relative_to(collector.config.rootpath)
        sys.modules.pop('.'.join(own.parts).removesuffix('.py'), None)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path, parent):
    """Stand in for files that import what is not here, be they tests or examples."""
    collected = yield
    reason = missing_for(file_path.read_text(encoding='utf-8')) if collected else ''
    return [stand_in(reason, file_path, parent)] if reason else collected


def pytest_addoption(parser):
    """Let ``./run test --quick`` choose."""
    words = 'of each test with many cases one alone, chosen by its name: some of every kind'
    parser.addoption('--one-case', action='store_true', help=words)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Keep one case of each test, the same in every worker, if that is asked for."""
    if not config.getoption('--one-case'):
        return
    cases = defaultdict(list)
    for item in items:
        cases[item.nodeid.partition('[')[0]].append(item)
    kept = {id(own[zlib.crc32(name.encode()) % len(own)]) for name, own in cases.items()}
    config.hook.pytest_deselected(items=[item for item in items if id(item) not in kept])
    items[:] = [item for item in items if id(item) in kept]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    """Stand in for tests that start nodes."""
    if item.get_closest_marker('ros') and missing_ros():
        refuse(missing_ros())
    IN_VAIN.clear()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Skip a test that failed where a library is not here that it asked for; in CI it fails."""
    report = yield
    if not report.failed or os.environ.get('CI'):
        return report
    error = call.excinfo.value
    reason = getattr(error, 'lacking', '') or lacking(
        error, IN_VAIN.union(said(report, call.excinfo.traceback))
    )
    if reason:
        error.lacking = reason  # for the other tests of a fixture that failed
        report.outcome = 'skipped'
        report.longrepr = (str(item.path), item.location[1], f'Skipped: {reason}')
    return report
