"""The check that every driver has to pass; a package that brings a driver calls it in its tests.

    check_driver(lambda context: MyDriver(bus, channels, context), {"arm.angle": 1234.0}, silence=..., restore=...)

The expected values are raw ones that the devices of a test bench send and keep sending. ``silence`` takes the devices
away and ``restore`` brings them back; they may be left out where a bench cannot do that.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from daq.drivers.base import Driver, DriverContext, Samples
from daq.frames.clock import NS
from daq.quality import Quality

ATTEMPTS = 400  # cycles within which a change on the bus has to show
JUMPS = 5  # of the cycle number, of which a shared computer may spoil some


class ConformanceError(AssertionError):
    """A driver does not do what the protocol says; the text says what."""


def check_driver(
    make: Callable[[DriverContext], Driver],
    expected: Mapping[str, float],
    *,
    period_s: float = 0.02,
    cycles: int = 20,
    silence: Callable[[], None] | None = None,
    restore: Callable[[], None] | None = None,
) -> None:
    """Run a driver against a bench through everything that acquisition relies on.

    Parameters
    ----------
    make : makes a new driver for the bench
    expected : channel name to the raw value that its device sends
    period_s : wall seconds per cycle
    cycles : cycles of the plain run
    silence, restore : take the devices away, and bring them back

    Raises
    ------
    ConformanceError
        Naming what is violated.
    """
    context = DriverContext(period_s=period_s, patience_s=0.0, monotonic_ns=time.monotonic_ns)
    for run in ("first", "second"):  # the second one finds a bus that the first one has released
        driver = make(context)
        _require(set(driver.channels) == set(expected), f"channels are {driver.channels}, not {tuple(expected)}")
        try:
            problems = driver.start()
            _require(problems == (), f"{run} start reports problems on a sound bench: {problems}")
            _plain_run(driver, expected, context, cycles)
            jumps = (cycles + 7 * jump for jump in range(1, JUMPS + 1))
            _require(
                any(_fresh(driver, expected, _cycle(driver, context, number)) for number in jumps),
                "a jump of the cycle number disturbs it",
            )
            if silence is not None and restore is not None and run == "first":
                after = cycles + 7 * JUMPS + 1
                silence()
                _until(driver, context, after, lambda s: bool(np.all(s.quality != Quality.FRESH)), "silence")
                what = "a device that is not running and says why (`detail`)"
                _until(driver, context, after, partial(_announced, driver), what)
                restore()
                _until(driver, context, after + ATTEMPTS, partial(_fresh, driver, expected), "recovery")
        finally:
            driver.stop()
        driver.stop()  # a second stop does nothing
        driver.trigger(10_000)  # late calls of a loop that is ending are harmless
        _shape(driver.collect(context.monotonic_ns()), len(driver.channels))


def _plain_run(driver: Driver, expected: Mapping[str, float], context: DriverContext, cycles: int) -> None:
    fresh = sum(_fresh(driver, expected, _cycle(driver, context, number)) for number in range(cycles))
    # A shared computer may not run us in time now and then; more than a few lost cycles are the driver's fault.
    _require(fresh >= 0.8 * cycles, f"only {fresh} of {cycles} cycles brought every channel fresh and right")
    statistics = driver.statistics()
    _require(bool(statistics.bus), "statistics name no bus")
    states = {device.state for device in statistics.devices}
    _require(bool(states), "statistics name no device")
    known = {"running", "commissioning", "silent", "failed"}
    _require(states <= known, f"unknown device states {states - known}; use {known}")


def _cycle(driver: Driver, context: DriverContext, number: int) -> Samples:
    start = context.monotonic_ns()
    driver.trigger(number)
    samples = driver.collect(start + round(0.9 * context.period_s * NS))
    _shape(samples, len(driver.channels))
    rest = start + round(context.period_s * NS) - context.monotonic_ns()
    if rest > 0:
        time.sleep(rest / NS)
    return samples


def _shape(samples: Samples, count: int) -> None:
    for name, kind in (("raw", "f"), ("quality", "u"), ("cycles_ago", "i"), ("after_sync_s", "f")):
        array = getattr(samples, name)
        _require(array.shape == (count,), f"samples.{name} has shape {array.shape}, not ({count},)")
        _require(array.dtype.kind == kind, f"samples.{name} has dtype {array.dtype}")
    nothing = (Quality.MISSING, Quality.INVALID, Quality.BUS_ERROR)
    allowed = (Quality.FRESH, Quality.LATE, Quality.EMERGENCY, *nothing)
    _require(bool(np.isin(samples.quality, allowed).all()), f"quality {samples.quality} is not a driver's to give")
    fresh = samples.quality == Quality.FRESH
    _require(bool(np.isfinite(samples.raw[fresh]).all()), "a fresh value is not finite")
    absent = np.isin(samples.quality, nothing)
    _require(bool(np.isnan(samples.raw[absent]).all()), "a value where nothing came")
    _require(bool((samples.cycles_ago >= 0).all()), "a value from a cycle to come")


def _fresh(driver: Driver, expected: Mapping[str, float], samples: Samples) -> bool:
    if not np.all(samples.quality == Quality.FRESH):
        return False
    for name, value in zip(driver.channels, samples.raw, strict=True):
        _require(bool(np.isclose(value, expected[name])), f"{name} is {value}, the device sends {expected[name]}")
    return bool(np.all(samples.cycles_ago == 0))


def _announced(driver: Driver, samples: Samples) -> bool:
    devices = [device for device in driver.statistics().devices if device.state != "running"]
    return bool(devices) and all(device.detail for device in devices)


def _until(driver: Driver, context: DriverContext, start: int, done: Callable[[Samples], bool], what: str) -> None:
    for number in range(start, start + ATTEMPTS):
        if done(_cycle(driver, context, number)):
            return
    raise ConformanceError(f"{what} does not show within {ATTEMPTS} cycles")


def _require(condition: bool, what: str) -> None:
    if not condition:
        raise ConformanceError(what)
