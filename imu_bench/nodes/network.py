# SPDX-License-Identifier: Apache-2.0
"""
Whom the nodes of a bench can be reached by: nobody but this machine, unless somebody asks.

The one place where that is chosen, for Fast DDS and for Cyclone DDS alike.  How each of them is
told is what its documentation says: XML profiles with transports of one's own and an interface
white list (Fast DDS 2.14), ``General/Interfaces`` (Cyclone DDS).
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
import os
import socket

from imu_bench.config.location import config_file
from imu_bench.errors import ConfigError

ALONE, ALL = 'lo', 'all'
"""The loopback interface and shared memory; and whatever the user's environment says."""

VARIABLE = 'IMU_BENCH_NETWORK'
"""Tells the nodes, and the profile of Fast DDS, what was chosen."""

CYCLONE = 'rmw_cyclonedds_cpp'
KNOWN = ('rmw_fastrtps_cpp', 'rmw_fastrtps_dynamic_cpp', CYCLONE)
"""Middlewares that can be kept from the network."""

CLEARED = (
    'ROS_STATIC_PEERS',
    'ROS_LOCALHOST_ONLY',
    'ROS_DISCOVERY_SERVER',
    'ROS_SUPER_CLIENT',
    'FASTDDS_BUILTIN_TRANSPORTS',
)
"""Variables of a user's shell that would lead out again, or open other transports."""

_PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
"""What names the profiles to Fast DDS 2 and 3."""

FIRST_WITH_FAST_DDS_3 = 9
"""Of rclpy: Kilted has 9.1 and Fast DDS 3.2, Jazzy 7.1 and Fast DDS 2.14."""

_MOST = 32
"""Participants of a domain that are looked for on this machine, as Fast DDS does here."""


def variables(network: str, environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """
    Return what the environment of every node of a bench has to say; '' is to be unset.

    Parameters
    ----------
    network : str
        `ALONE`, an interface, or `ALL`.
    environment : mapping of str to str
        That of the user.

    Raises
    ------
    ConfigError
        If there is no such interface, or the middleware in use is not known.

    Examples
    --------
    >>> variables('all')
    {'IMU_BENCH_NETWORK': 'all'}
    >>> variables('lo', {})['ROS_AUTOMATIC_DISCOVERY_RANGE']
    'SYSTEM_DEFAULT'
    """
    if network == ALL:
        return {VARIABLE: ALL}
    there = [name for _, name in socket.if_nameindex()]
    if network not in there:
        raise ConfigError(
            f'--network {network}: there is no such interface; there are {", ".join(there)}, '
            f'and {ALL!r} for all of them'
        )
    middleware = environment.get('RMW_IMPLEMENTATION', KNOWN[0])
    if middleware not in KNOWN:
        raise ConfigError(
            f'RMW_IMPLEMENTATION={middleware}: how to keep it from the network is not known here; '
            f'use {KNOWN[0]} or {CYCLONE}, or say --network {ALL}'
        )
    alone = network == ALONE
    profile = str(config_file(f'network/{"alone" if alone else "interface"}.xml').resolve())
    return {
        **dict.fromkeys(CLEARED, ''),
        VARIABLE: network,
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT' if alone else 'SUBNET',
        **dict.fromkeys(_PROFILES, ''),
        _profiles(): profile,
        'SKIP_DEFAULT_XML_FILE': '1',  # no DEFAULT_FASTRTPS_PROFILES.xml of the current folder
        'CYCLONEDDS_URI': _cyclone(network),
    }


def _profiles() -> str:
    """Return which of the names Fast DDS knows its profiles by; 3 complains of that of 2."""
    try:
        major = int(version('rclpy').partition('.')[0])
    except PackageNotFoundError:
        major = 0
    return _PROFILES[major >= FIRST_WITH_FAST_DDS_3]


def apply(chosen: Mapping[str, str]) -> None:
    """Put this process's ROS 2 into the environment that `variables` has returned."""
    for name, value in chosen.items():
        if value:
            os.environ[name] = value
        else:
            os.environ.pop(name, None)


def words(environment: Mapping[str, str] = os.environ) -> str:
    """
    Say who reaches nodes with this environment.

    Examples
    --------
    >>> words({'IMU_BENCH_NETWORK': 'lo'}), words({'IMU_BENCH_NETWORK': 'eth0'})
    ('this machine only', 'open to the network on eth0')
    >>> words({'IMU_BENCH_NETWORK': 'all'}), words({})
    ('open to the network on all interfaces', 'as the environment of the node says')
    """
    network = environment.get(VARIABLE)
    if network is None:
        return 'as the environment of the node says'
    if network == ALONE:
        return 'this machine only'
    where = 'all interfaces' if network == ALL else network
    return f'open to the network on {where}'


def for_other_shells(environment: Mapping[str, str]) -> str:
    """
    Say what another shell of this machine needs to see the bench.

    Examples
    --------
    >>> for_other_shells({'ROS_DOMAIN_ID': '18'})
    'other shells see it with: export ROS_DOMAIN_ID=18'
    """
    domain = environment.get('ROS_DOMAIN_ID', '0')
    said = f'other shells see it with: export ROS_DOMAIN_ID={domain}'
    uri = environment.get('CYCLONEDDS_URI')
    if uri and environment.get('RMW_IMPLEMENTATION') == CYCLONE:
        # by itself Cyclone DDS uses an interface of the network, never loopback beside it
        said += f" CYCLONEDDS_URI='{uri}'"
    return said


def _cyclone(network: str) -> str:
    """Return the setting of Cyclone DDS, in the variable itself."""
    loopback = f'<NetworkInterface name="{ALONE}"/>'
    general = f'<Interfaces>{loopback}</Interfaces><AllowMulticast>false</AllowMulticast>'
    if network != ALONE:
        general = f'<Interfaces><NetworkInterface name="{network}"/></Interfaces>'
    peers = (
        '<ParticipantIndex>auto</ParticipantIndex>'
        f'<MaxAutoParticipantIndex>{_MOST}</MaxAutoParticipantIndex>'
        '<Peers><Peer address="127.0.0.1"/></Peers>'
    )
    discovery = f'<Discovery>{peers}</Discovery>' if network == ALONE else ''
    return f'<CycloneDDS><Domain><General>{general}</General>{discovery}</Domain></CycloneDDS>'
