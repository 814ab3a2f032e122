"""True valves, oil and load of a simulated machine; no machine file carries any of it.

Commands and spool strokes are fractions of full: -1 (full speed in), 0 (closed), 1 (full speed out). All else is SI.
An axis has four lands, of which two are open at a time: ``head_in`` and ``rod_out`` let the rod out, ``rod_in`` and
``head_out`` let it in. The values here are a healthy axis; what an undeclared effect is made of is 0 (or infinite).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import yaml

from daq import safe_yaml
from daq.errors import InputError
from sim_backends.plant.truth import LinkTruth

SupplyKind = Literal["constant_pressure", "load_sensing"]
LANDS = ("head_in", "rod_in", "head_out", "rod_out")


@dataclass(frozen=True)
class Land:
    """One edge of the spool: ``flow ((|y| - edge) / (1 - edge))^exponent``, levelling out at ``saturation`` of it."""

    edge: float  # stroke at which it opens, fraction of full: the dead band
    flow: float  # m^3/s at full stroke and the valve's nominal drop
    exponent: float = 1.0
    saturation: float = float("inf")  # opening, fraction of full, above which more stroke gives no more flow
    rounding: float = 0.0  # stroke, fraction of full: a worn edge lets oil through before it opens


@dataclass(frozen=True)
class Spool:
    """Path of a command to a stroke: delay, hysteresis, stick, then a spring-mass-damper.

    ``y'' + 2 damping w y' + w^2 y = w^2 x(t)``, ``w = 2 pi frequency``; ``x`` is the command ``delay_extend`` s ago
    where it lets the rod out and ``delay_retract`` s ago where it lets it in, after hysteresis and stick.
    """

    delay_extend: float  # s
    delay_retract: float  # s
    frequency: float = 12.0  # Hz
    damping: float = 0.8
    retracting: float = 1.0  # frequency on the side that lets the rod in, over ``frequency``
    null: float = 0.0  # stroke at command 0
    play: float = 0.0  # half-width of a mechanical play between solenoid and spool, fraction of full
    magnetic: float = 0.0  # half-width of the solenoid's loop at full current; smaller loops are narrower
    stick: float = 0.0  # change of the command that a spool at rest ignores, fraction of full
    silt_time: float = 0.0  # s at rest after which most of ``stick`` is there; 0: at once
    restless: float = 0.0  # standard deviation of what the pilot stage adds to the stroke at random, fraction of full
    restless_time: float = 0.2  # s, its correlation time
    current_loss: float = 0.0  # fraction of the stroke that a coil at working temperature has lost against a cold one

    @property
    def lateness(self) -> float:
        """Mean delay and lag ``2 damping / w`` in s: at 3 Hz they are inseparable."""
        return 0.5 * (self.delay_extend + self.delay_retract) + self.damping / (math.pi * self.frequency)


@dataclass(frozen=True)
class ValveTruth:
    """The valve of an axis.

    ``compensation`` is the drop in Pa that a compensator keeps over the meter-in land: above it the flow is that of
    this drop, below it that of an orifice (infinite: no compensator). ``softness`` is what a real compensator leaves
    of the pressure: flow goes with ``(drop / compensation)^(softness / 2)`` above it.
    """

    spool: Spool
    lands: Mapping[str, Land]  # by name, all of LANDS
    nominal_drop: float = 1.0e6  # Pa at which the lands' flows are given
    compensation: float = float("inf")  # Pa
    softness: float = 0.0
    load_check: bool = True  # no oil goes back to the pump
    clearance: float = 0.0  # m^3/s/Pa from each port to tank through the spool's gap while it is centred
    cold_flow: float = 0.0  # fraction of the flow that cold oil lacks


@dataclass(frozen=True)
class Counterbalance:
    """A load-holding valve on a chamber: opens with its own pressure and a pilot from the other chamber.

    The opening is ``(p + ratio p_other - setting) / span`` between 0 and 1, followed with ``lag`` s.
    """

    chamber: Literal["head", "rod"]
    setting: float  # Pa
    ratio: float
    span: float  # Pa
    flow: float  # m^3/s at the valve's nominal drop, fully open
    lag: float = 0.02  # s


@dataclass(frozen=True)
class CylinderOil:
    """The cylinder as oil sees it; bore, rod and stroke are the machine file's."""

    head_dead: float  # m^3 of oil at the retracted end, head chamber with its line
    rod_dead: float  # m^3 at the extended end
    head_hose: float = 0.0  # m^3/Pa that the hose gives
    rod_hose: float = 0.0
    mass: float = 0.0  # kg of piston and rod
    f_c: float = 0.0  # N
    f_v: float = 0.0  # N s/m
    spring: float = 0.0  # N/m from the retracted end: a load that depends on the position
    relief: float = 40.0e6  # Pa at which the port relief valves open
    counterbalance: Counterbalance | None = None
    piston_leak: float = 0.0  # m^3/s/Pa past a worn seal, laminar
    piston_gap: float = 0.0  # m^3/s/sqrt(Pa) past a scored bore, turbulent
    head_leak: float = 0.0  # m^3/s/Pa from the head port to tank
    rod_leak: float = 0.0
    line_in: float = float("inf")  # m^3/s at the nominal drop: a throttle in both lines, oil to the chamber
    line_out: float = float("inf")  # the same, oil from the chamber


@dataclass(frozen=True)
class SupplyTruth:
    """The pump, the volume behind it, and the tank line.

    A pump holds ``pressure``; a load-sensing one the highest load and ``margin``, followed with ``lag`` s, never below
    ``standby`` and never above ``pressure``. It gives at most ``flow_limit`` and at most ``power_limit``.
    """

    kind: SupplyKind = "constant_pressure"
    pressure: float = 21.0e6  # Pa
    tank: float = 0.5e6  # Pa that the return line keeps
    flow_limit: float = float("inf")  # m^3/s
    power_limit: float = float("inf")  # W
    volume: float = 2.0e-3  # m^3 between pump and valves
    droop: float = 5.0e5  # Pa below the wanted pressure at which the pump gives ``full_flow``
    full_flow: float = 2.0e-3  # m^3/s
    margin: float = 2.0e6  # Pa
    standby: float = 2.5e6  # Pa
    lag: float = 0.05  # s


@dataclass(frozen=True)
class OilTruth:
    """The oil, and how warm it is: ``ambient + heating (1 - exp(-t / warm_up))``, t from power-on."""

    bulk_modulus: float = 1.1e9  # Pa
    ambient: float = 295.0  # K
    heating: float = 20.0  # K
    warm_up: float = 900.0  # s


@dataclass(frozen=True)
class ValvePlantTruth:
    """Everything that the plant knows and an identification has to find, by name of joint."""

    links: tuple[LinkTruth, ...]
    valves: Mapping[str, ValveTruth]
    cylinders: Mapping[str, CylinderOil]
    supply: SupplyTruth = field(default_factory=SupplyTruth)
    oil: OilTruth = field(default_factory=OilTruth)

    def to_dict(self) -> dict[str, Any]:
        """Convert to plain lists and mappings, for YAML or JSON."""
        content = asdict(self)
        content["links"] = [link.as_list() for link in self.links]
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> ValvePlantTruth:
        """Invert :meth:`to_dict`; leave alone keys that are not the plant's."""
        return cls(
            links=tuple(LinkTruth.from_list([float(v) for v in link]) for link in content["links"]),
            valves={name: _valve(v) for name, v in content["valves"].items()},
            cylinders={name: _cylinder(c) for name, c in content["cylinders"].items()},
            supply=SupplyTruth(**(content.get("supply") or {})),
            oil=OilTruth(**(content.get("oil") or {})),
        )


def _valve(content: Mapping[str, Any]) -> ValveTruth:
    lands = {name: Land(**land) for name, land in content["lands"].items()}
    return ValveTruth(**{**content, "spool": Spool(**content["spool"]), "lands": lands})


def _cylinder(content: Mapping[str, Any]) -> CylinderOil:
    held = content.get("counterbalance")
    return CylinderOil(**{**content, "counterbalance": None if held is None else Counterbalance(**held)})


def load_valve_truth(path: str | Path) -> ValvePlantTruth:
    """Read a plant's truth from YAML.

    Raises
    ------
    InputError
        If the file is not there or is no description of such a plant.
    """
    path = Path(path)
    try:
        content = safe_yaml.read(path.read_text(encoding="utf-8"))[1]
        if not isinstance(content, dict):
            raise ValueError("no mapping")
        return ValvePlantTruth.from_dict(content)
    except FileNotFoundError:
        raise InputError("sim_backends.no_valve_truth_file", path=path) from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError) as error:
        what = " ".join(str(error).split())[:120]
        raise InputError("sim_backends.not_a_valve_truth", path=path, error=what) from None
