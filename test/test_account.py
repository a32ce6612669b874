# SPDX-License-Identifier: Apache-2.0
"""Where the samples of a bench have got to, and what is said of it."""

from imu_bench import account


def test_a_machine_that_is_too_small_is_told_so():
    small = account.Account('a', read=900, chip=100)
    fine = account.Account('b', read=990, chip=10)
    assert account.advice([small])[-1].startswith('this machine is too small for this bench')
    assert not [line for line in account.advice([fine]) if 'too small' in line]
    # a chip that a script of faults unplugged says nothing of the machine
    assert not account.advice([account.Account('c', read=500, scripted=500)])
