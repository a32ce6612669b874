# SPDX-License-Identifier: Apache-2.0
"""
The metadata.yaml of a ROS 2 bag, versions 1 to 9.

Source: rosbag2, rosbag2_storage/yaml.hpp and the ``bag_metadata`` structure; version 2
changed integer sizes, 3 added compression, 4 QoS and relative paths, 5 the list of
files, 6 custom data, 7 type hashes, 8 the distribution, 9 spelled-out QoS values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import os
from pathlib import Path, PurePosixPath
from typing import Any

from imu_bench.bags.block import printable
from imu_bench.bags.topic_info import NEVER, TopicInfo
from imu_bench.config.files import load
from imu_bench.errors import RecordingError
import yaml

FILE_NAME = 'metadata.yaml'
NEWEST_VERSION = 9
_ROOT = 'rosbag2_bagfile_information'
_MAX_SIZE = 1 << 22
"""Bytes: an entry of one topic or file has 250 or more; read, it takes a hundred times as much."""
_MOST = 1_000_000


def ros_distro() -> str:
    """Return the ROS 2 that is sourced, or of the wheels here; without any, that we write for."""
    from importlib.metadata import Distribution

    wheels = any(Distribution.discover(name='ros-kilted-rclpy'))
    return os.environ.get('ROS_DISTRO') or ('kilted' if wheels else 'jazzy')


@dataclass(frozen=True)
class Announcement:
    """What a metadata file says about its bag."""

    version: int
    storage: str  # 'sqlite3', 'mcap' or another storage plugin
    files: tuple[str, ...]  # names of the storage files, in order, without folders
    counts: dict[str, int] = field(default_factory=dict)  # messages by topic
    serializations: dict[str, str] = field(default_factory=dict)  # serialization format by topic
    message_count: int = 0
    # compression_format, compression_mode: empty, or 'zstd' and 'file' or 'message', in lower case
    compression_format: str = ''
    compression_mode: str = ''
    # custom data: what whoever recorded it wanted to say
    custom: dict[str, str] = field(default_factory=dict)


def read(path: Path) -> Announcement:
    """
    Return the content of a metadata file.

    Raises
    ------
    RecordingError
        If it is not YAML or does not say what every version says.
    """
    if path.stat().st_size > _MAX_SIZE:
        raise RecordingError(f'{path}: larger than {_MAX_SIZE >> 20} MiB')
    try:
        loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
        document = load(path.read_bytes(), loader, _MOST)
        return parse(document)
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, OverflowError) as problem:
        reason = printable(' '.join(str(problem).split()))
        raise RecordingError(f'{path}: damaged: {reason}') from problem
    except (KeyError, TypeError, AttributeError) as problem:
        raise RecordingError(f'{path}: an entry is missing or misplaced: {problem!r}') from problem


def parse(document: dict[str, Any]) -> Announcement:
    """Return the content of a loaded metadata document."""
    bag = document[_ROOT]
    counts: dict[str, int] = {}
    serializations: dict[str, str] = {}
    for entry in bag.get('topics_with_message_count') or ():
        topic = entry['topic_metadata']
        name = printable(str(topic['name']))
        counts[name] = counts.get(name, 0) + int(entry['message_count'])
        serializations[name] = printable(str(topic.get('serialization_format', '')))
    mode = str(bag.get('compression_mode') or '').lower()
    return Announcement(
        version=int(bag['version']),
        storage=str(bag['storage_identifier']),
        files=tuple(
            printable(PurePosixPath(str(name)).name) for name in bag['relative_file_paths'] or ()
        ),
        counts=counts,
        serializations=serializations,
        message_count=int(bag.get('message_count') or 0),
        compression_format=str(bag.get('compression_format') or '').lower(),
        compression_mode='' if mode == 'none' else mode,
        custom=_custom(bag.get('custom_data')),
    )


def _custom(found: object) -> dict[str, str]:
    if not isinstance(found, Mapping):
        return {}
    return {str(key): str(value) for key, value in found.items()}


@dataclass(frozen=True)
class StoredFile:
    """A finished storage file: its name, what is in it, first and last receive time in ns."""

    name: str
    counts: Mapping[str, int]
    first_ns: int
    last_ns: int

    @property
    def message_count(self) -> int:
        """Messages in the file."""
        return sum(self.counts.values())

    def entry(self) -> dict[str, Any]:
        """Return the entry of metadata.yaml."""
        return {'path': self.name, **_extent((self,)), 'message_count': self.message_count}


def document(
    storage: str,
    files: Sequence[StoredFile],
    topics: Sequence[TopicInfo],
    distro: str,
    custom: Mapping[str, str],
) -> dict[str, Any]:
    """Return the content of a metadata file of version 9."""
    counts = {
        topic.name: sum(file.counts.get(topic.name, 0) for file in files) for topic in topics
    }
    return {
        'version': NEWEST_VERSION,
        'storage_identifier': storage,
        **_extent(files),
        'message_count': sum(counts.values()),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [profile.entry() for profile in topic.qos],
                    'type_description_hash': topic.type_hash,
                },
                'message_count': counts[topic.name],
            }
            for topic in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [file.entry() for file in files],
        'custom_data': dict(custom) or None,
        'ros_distro': distro,
    }


def text(content: Mapping[str, Any]) -> str:
    """Return a metadata document as the storage files hold it."""
    return yaml.safe_dump(dict(content), sort_keys=False)


def write(path: Path, content: Mapping[str, Any]) -> None:
    """Write a metadata file; it is there completely or not at all."""
    draft = path.with_suffix('.tmp')
    try:
        draft.write_text(text({_ROOT: dict(content)}), encoding='utf-8')
        draft.replace(path)
    except OSError:
        draft.unlink(missing_ok=True)
        raise


def _extent(files: Sequence[StoredFile]) -> dict[str, Any]:
    filled = [file for file in files if file.message_count]
    first = min((file.first_ns for file in filled), default=NEVER)
    last = max((file.last_ns for file in filled), default=first)
    return {
        'duration': {'nanoseconds': last - first},
        'starting_time': {'nanoseconds_since_epoch': first},
    }
