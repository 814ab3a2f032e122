"""Intervals of parameters, beside the plant's own values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import reduce_parameters
from sim_backends.plant.truth import Truth

DRIVE = ("m", "K", "f_c", "f_v", "f_s")


@dataclass(frozen=True)
class Interval:
    """A parameter's estimate beside its truth."""

    name: str
    value: float
    std: float
    truth: float

    @property
    def sigmas(self) -> float:
        """Distance from the truth in standard deviations."""
        return (self.value - self.truth) / self.std if self.std > 0 else float(np.inf)


def true_values(machine: Machine, truth: Truth) -> dict[str, float]:
    """Return the plant's parameters by the names that an identification gives them."""
    values = {
        f"{name}.{symbol}": float(getattr(law, symbol)) for name, law in truth.cylinders.items() for symbol in DRIVE
    }
    base = reduce_parameters(machine)
    pi = np.array([link.as_list() for link in truth.links])
    if base.regrouping.shape[1] != pi.size:  # friction and drive inertia of each joint are standard parameters, too
        pi = np.hstack([pi, np.zeros((len(pi), base.regrouping.shape[1] // len(pi) - pi.shape[1]))])
    return values | dict(zip(base.names, base.from_standard(pi).tolist(), strict=True))


def intervals(values: Mapping[str, tuple[float, float]], truth: Mapping[str, float]) -> list[Interval]:
    """Collect estimates of all parameters whose truth is known."""
    return [Interval(name, value, std, truth[name]) for name, (value, std) in values.items() if name in truth]


def kind_of(name: str) -> str:
    """Name kinds: ``joint1.f_c`` an ``f_c``; ``ZZ2`` an ``inertia``, ``MX3`` a ``first moment``, ``m4`` a ``mass``."""
    if "." in name:
        return name.rpartition(".")[2]
    symbol = name.rstrip("0123456789")
    return {"M": "first moment", "m": "link mass"}.get(symbol[:1], "inertia")
