# SPDX-License-Identifier: Apache-2.0
"""
Who answers, and what it is.  Nothing is ever written to a register.

I²C: at the addresses that the drivers know, and at no others, the identity register is read
(its number, a repeated start, the bytes); of a die without one, the first register that may be
read without changing anything.  SPI: the identity registers of chips whose reads begin with a
one: chips of other protocols take the two bytes for the beginning of nothing.  Chips whose read
bit is the last one (others would take it for a write), that talk in frames, or over a serial
line are asked only where a bench says that they are there.  Banks
are not selected, and what another program uses, or a kernel driver has taken, is left alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Any

from imu_bench import drivers
from imu_bench.bus.claim import ChipInUse
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.i2c import I2cBus
from imu_bench.bus.interface import RegisterBus
from imu_bench.bus.opening import kind_among, open_bus
from imu_bench.bus.spi import SpiFrameBus, SpiRegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.config import SensorConfig
from imu_bench.doctor.machine import Bus, kernel_driver
from imu_bench.drivers.driver import Driver, Identity
from imu_bench.errors import BenchError, BusBusy, IdentityError, NoAnswer, NotReady
from imu_bench.registers import Register

READ_BIT = 0x80

MEMORIES = range(0x50, 0x58)
"""Where memories live, such as that of a display or a HAT: never asked in a scan."""

_WIDTH = {1: 2, 2: 4, 3: 6}


@dataclass(frozen=True)
class Answer:
    """What is at one place."""

    device: str
    address: int | None  # on I²C
    state: str  # 'known', 'unknown', 'in use', 'kernel driver', or 'failed'
    what: str  # the part, or why it is not known
    drivers: tuple[str, ...] = ()  # those that know it


@dataclass(frozen=True)
class _Candidate:
    """A die that may be at a place, and the register to ask it."""

    driver: type[Driver]
    wiring: Wiring
    register: Register
    identity: Identity | None


def scan(bus: Bus) -> list[Answer]:
    """Return who answers on a bus; on a serial line nobody is asked."""
    if bus.kind == 'i2c':
        return list(_scan_i2c(bus.device))
    return list(_scan_spi(bus.device)) if bus.kind == 'spi' else []


def _scan_i2c(device: str) -> Iterator[Answer]:
    addresses = {a for c in _candidates('i2c') for a in c.wiring.i2c_addresses}
    try:
        for address in sorted(addresses - set(MEMORIES)):
            yield from _at(device, address)
    except BusBusy as error:  # every other address would take as long
        yield Answer(device, None, 'failed', str(error))


def _at(device: str, address: int) -> Iterator[Answer]:
    """Yield who is at an address, if anybody; raises BusBusy if the bus is stuck."""
    if kernel := kernel_driver(device, address):
        yield Answer(device, address, 'kernel driver', f'{kernel} of the kernel has it')
        return
    candidates = [c for c in _candidates('i2c') if address in c.wiring.i2c_addresses]
    try:
        found = _ask(candidates, lambda c: I2cBus(device, address, c.wiring, 0.0))
    except NoAnswer:
        return
    except ChipInUse as error:
        yield Answer(device, address, 'in use', str(error))
    except BusBusy:
        raise
    except BenchError as error:
        yield Answer(device, address, 'failed', str(error))
    else:
        yield Answer(device, address, *found)


def _scan_spi(device: str) -> Iterator[Answer]:
    candidates = [c for c in _candidates('spi') if c.wiring.spi_read == READ_BIT and c.identity]
    try:
        found = _ask(
            candidates, lambda c: SpiRegisterBus(SpiFrameBus(device, c.wiring, 0.0), c.wiring)
        )
    except NoAnswer:
        return
    except ChipInUse as error:
        yield Answer(device, None, 'in use', str(error))
    except BenchError as error:
        yield Answer(device, None, 'failed', str(error))
    else:
        state, what, who = found
        if state == 'unknown':
            what += f'; asked only where a bench says so: {", ".join(_not_scanned_for())}'
        yield Answer(device, None, state, what, who)


def _not_scanned_for() -> Iterator[str]:
    """Yield the drivers on SPI whose question another chip could take for an order."""
    for name in drivers.names():
        driver = drivers.load(name)
        late = 'spi' in driver.bus_kinds and driver.wiring[''].spi_read != READ_BIT
        if late or 'frame' in driver.bus_kinds:
            yield name


def _candidates(kind: str) -> Iterator[_Candidate]:
    """Yield every die of every driver that can be on such a bus."""
    for name in drivers.names():
        driver = drivers.load(name)
        if kind not in driver.bus_kinds:
            continue
        for part, wiring in driver.wiring.items():
            if wiring.i2c_addresses if kind == 'i2c' else wiring.spi_max_hz:
                yield _Candidate(driver, wiring, *_question(driver, part, kind))


def _question(driver: type[Driver], part: str, kind: str) -> tuple[Register, Identity | None]:
    """Return the register to read of a die, and what its identity would be."""
    for identity in driver.identities:
        if identity.register.part == part:
            return identity.register, identity
    own = [r for r in driver.declared(Register).values() if r.part == part]
    for register in own:
        if register.access != 'wo' and not register.clear_on_read:
            return register, None
    # a converter has its registers under its own name
    return next(iter(driver.channels_on(kind).values())).first, None


def _ask(candidates: list[_Candidate], opened: Any) -> tuple[str, str, tuple[str, ...]]:
    """Return state, what it is, and who knows it."""
    known: dict[str, str] = {}
    silent: BenchError = NoAnswer('nothing answers')
    unknown: list[str] = []
    guesses: list[str] = []
    answered = False
    for candidate in candidates:
        bus: RegisterBus = opened(candidate)
        try:
            register = candidate.register
            word = register.unpack(bus.read(register.address, register.size))
        except NoAnswer as error:
            silent = error
            continue
        finally:
            bus.close()
        driver, identity = candidate.driver, candidate.identity
        if identity is None:
            answered = True
            guesses.append(driver.name)
        elif word in identity.expected:
            known[driver.name] = identity.expected[word]
        elif word not in (0, (1 << 8 * register.size) - 1) or word in identity.others:
            answered = True
            meant = identity.others.get(word)
            said = f'0x{register.address:02X} holds 0x{word:0{_WIDTH.get(register.size, 8)}X}'
            unknown.append(meant or f'{said}, which is not {driver.title}')
        else:
            unknown.append('')
    if known:
        return 'known', ', '.join(dict.fromkeys(known.values())), tuple(known)
    if answered and guesses:
        what = f'something without an identity register: {" or ".join(guesses)}?'
        return 'unknown', what, tuple(guesses)
    texts = [text for text in dict.fromkeys(unknown) if text]
    if answered:
        return 'unknown', '; '.join(texts), ()
    raise silent


def check(sensor: SensorConfig) -> str:
    """Return what the hardware of a sensor is."""
    driver = drivers.load(sensor.driver)
    kind = kind_among(sensor.bus, driver.bus_kinds)
    buses = open_bus(sensor.bus, driver.wiring, driver.bus_kinds, patience_s=0.0, **sensor.place)
    try:
        return _identified(driver, buses, kind, sensor)
    except IdentityError as error:
        problem = error
    finally:
        for wire in buses.values():
            wire.close()
    raise IdentityError(f'{problem}{_instead(sensor) if kind == "i2c" else ""}') from problem


def _instead(sensor: SensorConfig) -> str:
    """Return which part with a driver of its own is where a sensor should be; '' if none."""
    address = sensor.address or drivers.load(sensor.driver).wiring[''].i2c_addresses[0]
    device = f'/dev/{PurePosixPath(sensor.bus).name}'
    answer = next(_at(device, address), None)
    if answer is None or answer.state != 'known' or sensor.driver in answer.drivers:
        return ''
    return f'; {answer.what} answers there, driver: {" or ".join(answer.drivers)}'


def _identified(driver: type[Driver], buses: Any, kind: str, sensor: SensorConfig) -> str:
    device = driver(buses, SystemClock(), sensor.settings)
    found = [
        # without its bank: selecting it would be a write
        device.check_identity(replace(identity, register=_unbanked(identity.register)))
        for identity in driver.identities
        if identity.register.part in buses
    ]
    if found:
        return found[0]
    if kind == 'i2c':
        register, _ = _question(driver, '', kind)
        buses[''].read(register.address, register.size)
        return f'{driver.title} has no identity register; something answers'
    raise NotReady(
        f'{sensor.bus} can be opened; {driver.title} cannot be asked who it is without changing '
        'what it does, its node will do so'
    )


def _unbanked(register: Register) -> Register:
    plain = replace(register, bank=None)
    object.__setattr__(plain, 'name', register.name)
    return plain
