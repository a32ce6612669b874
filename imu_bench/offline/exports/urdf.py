# SPDX-License-Identifier: Apache-2.0
"""Where the sensors of a bench are, as robot_state_publisher reads it: URDF."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree

from imu_bench.config import BenchConfig
from imu_bench.errors import ConfigError


def urdf(bench: BenchConfig) -> str:
    """
    Return the sensors of a bench that have a place, as fixed joints of a robot.

    Links and joints as in the XML specification of URDF: a tree with one root, lengths in m, roll,
    pitch and yaw in rad about fixed axes.

    Raises
    ------
    ConfigError
        If no sensor has a place, or their places are no tree.

    Examples
    --------
    >>> from imu_bench.config import SensorConfig
    >>> from msg_conversions.transforms import Mounting
    >>> left = SensorConfig('left', 'mpu9250', 'emulated', mounting=Mounting('base_link'))
    >>> print(urdf(BenchConfig('mine', sensors=(left,))).splitlines()[2].strip())
    <link name="base_link" />
    """
    placed = [(one, one.mounting) for one in bench.sensors if one.mounting is not None]
    if not placed:
        raise ConfigError(
            f'bench {bench.name}: no sensor has a place; give entries mounting: {{xyz: …, rpy: …}}'
        )
    parents = {sensor.frame_id: place.parent for sensor, place in placed}
    roots = sorted({_root(frame, parents, bench.name) for frame in parents})
    if len(roots) > 1:
        raise ConfigError(
            f'bench {bench.name}: mounting.parent leads to {" and ".join(roots)}; a URDF has one '
            'root'
        )
    robot = ElementTree.Element('robot', name=bench.name)
    for link in dict.fromkeys([*roots, *parents]):
        ElementTree.SubElement(robot, 'link', name=link)
    for sensor, place in placed:
        joint = ElementTree.SubElement(robot, 'joint', name=f'{sensor.name}_mounting')
        joint.set('type', 'fixed')
        ElementTree.SubElement(joint, 'parent', link=place.parent)
        ElementTree.SubElement(joint, 'child', link=sensor.frame_id)
        ElementTree.SubElement(joint, 'origin', xyz=_three(place.xyz), rpy=_three(place.rpy))
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, "unicode")}\n'


def _root(frame: str, parents: dict[str, str], bench: str) -> str:
    """Return where the parents of a frame lead."""
    passed = [frame]
    while passed[-1] in parents:
        passed.append(parents[passed[-1]])
        if passed[-1] in passed[:-1]:
            raise ConfigError(
                f'bench {bench}: mounting.parent goes round in a circle: {" to ".join(passed)}'
            )
    return passed[-1]


def _three(values: Iterable[float]) -> str:
    return ' '.join(f'{value:.9g}' for value in values)
