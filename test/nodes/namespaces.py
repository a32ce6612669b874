# SPDX-License-Identifier: Apache-2.0
"""Two hosts on a cable: network namespaces, each with a /dev/shm and an identity of its own."""

import os
from pathlib import Path
import subprocess

HOME, AWAY = '10.77.0.1', '10.77.0.2'
"""Addresses of the bench and of the visitor."""

IDENTITY = Path('/etc/machine-id')
"""By what Fast DDS 3 tells hosts apart (``Host::compute_machine_id``): equal ones share memory."""


class Hosts:
    """
    The bench's host and the visitor's; works for root, and where user namespaces are permitted.

    Raises
    ------
    OSError or subprocess.CalledProcessError
        If namespaces are not permitted, with what was said.
    """

    def __init__(self):
        self._holders = []
        try:
            self._home = self._hold('unshare', '--user', '--map-root-user', '--net', '--mount')
            self._away = self._hold(*self._enter(self._home), 'unshare', '--net', '--mount')
            pid = str(self._away)
            self._do(
                self._home, 'ip', 'link', 'add', 'v0', 'type', 'veth',
                'peer', 'name', 'v1', 'netns', pid,
            )  # fmt: skip
            for pid, link, address in ((self._home, 'v0', HOME), (self._away, 'v1', AWAY)):
                self._do(pid, 'ip', 'address', 'add', f'{address}/24', 'dev', link)
                for each in ('lo', link):
                    self._do(pid, 'ip', 'link', 'set', each, 'up')
                self._do(pid, 'mount', '-t', 'tmpfs', 'none', '/dev/shm')
                if IDENTITY.exists():
                    own = '/dev/shm/machine-id'
                    made = f'tr -d - </proc/sys/kernel/random/uuid >{own}'
                    self._do(pid, 'sh', '-c', f'{made} && mount --bind {own} {IDENTITY}')
        except BaseException:
            self.close()
            raise

    def _hold(self, *command):
        """Return the process that keeps new namespaces alive."""
        holder = subprocess.Popen(
            [*command, 'sh', '-c', 'echo $$; exec cat'],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._holders.append(holder)
        said = holder.stdout.readline()
        if not said:
            raise OSError(holder.stderr.read().strip())
        return int(said)

    def _enter(self, pid):
        return [
            'nsenter', '--target', str(pid), '--user', '--net', '--mount',
            '--preserve-credentials', f'--wd={Path.cwd()}',
        ]  # fmt: skip

    def _do(self, pid, *command):
        subprocess.run([*self._enter(pid), *command], check=True, capture_output=True, text=True)

    def at_home(self, *command):
        """Return a command that runs on the host of the bench."""
        return [*self._enter(self._home), *map(str, command)]

    def away(self, *command):
        """Return a command that runs on the visitor's host."""
        return [*self._enter(self._away), *map(str, command)]

    def close(self):
        """Take both down."""
        for holder in reversed(self._holders):
            holder.communicate()


def plain_environment(**more):
    """Return the environment of a user who has set nothing but his domain."""
    ours = ('ROS_', 'FAST', 'CYCLONE', 'IMU_BENCH', 'SKIP_')
    kept = {name: text for name, text in os.environ.items() if not name.startswith(ours)}
    return {**kept, 'ROS_DOMAIN_ID': os.environ['ROS_DOMAIN_ID'], 'PYTHONUNBUFFERED': '1', **more}


def sockets(pids):
    """Return the local addresses of the UDP and TCP sockets of processes, from /proc."""
    inodes = set()
    for pid in pids:
        for link in Path(f'/proc/{pid}/fd').iterdir():
            try:
                target = os.readlink(link)
            except FileNotFoundError:  # closed meanwhile
                continue
            if target.startswith('socket:['):
                inodes.add(target[8:-1])
    found = set()
    for pid in pids:
        for kind in ('udp', 'tcp', 'udp6', 'tcp6'):
            for line in Path(f'/proc/{pid}/net/{kind}').read_text().splitlines()[1:]:
                fields = line.split()
                if fields[9] in inodes:
                    found.add(fields[1].partition(':')[0])
    return found
