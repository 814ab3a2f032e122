"""Truth of the simulated machine: the plant's own parameters, which no machine file carries.

Only the plant reads these. A machine file has where pins and pressures are; a :class:`Truth` has how heavy the
links are and how the cylinders rub. The YAML form is the one beside generated cases (``truth.yaml``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import yaml

from daq import safe_yaml
from daq.errors import InputError


@dataclass(frozen=True)
class CylinderTruth:
    """Cylinder: ``m x'' + c x' + K x + F_d(x') = p1 A1 - p2 A2 - F_l``.

    ``F_d(v) = f_c sgn v + f_v v + f_s |v|^(1/3) sgn v``; ``c`` is declared in the machine file (``damping``).
    """

    m: float  # kg, moving mass
    K: float  # N/m, stiffness from the fully retracted position
    f_c: float  # N
    f_v: float  # N s/m
    f_s: float  # N (s/m)^(1/3)


@dataclass(frozen=True)
class DriveTruth:
    """A joint without cylinder: ``tau = load + inertia q'' + f_c sgn q' + f_v q'``."""

    f_c: float  # N m, or N
    f_v: float  # N m s/rad, or N s/m
    inertia: float  # kg m^2, or kg


@dataclass(frozen=True)
class LinkTruth:
    """Inertial parameters of one link about the origin of its distal Denavit-Hartenberg frame.

    ``inertia`` is the tensor ``(XX, XY, XZ, YY, YZ, ZZ)`` with its products as tensor elements (``XY = -sum m x y``).
    """

    mass: float  # kg
    moment: tuple[float, float, float]  # kg m, mass times centre of mass
    inertia: tuple[float, float, float, float, float, float]  # kg m^2

    def as_list(self) -> list[float]:
        """List the ten numbers: mass, first moments, tensor."""
        return [self.mass, *self.moment, *self.inertia]

    @classmethod
    def from_list(cls, values: list[float]) -> LinkTruth:
        """Invert :meth:`as_list`."""
        mass, mx, my, mz, xx, xy, xz, yy, yz, zz = values
        return cls(mass, (mx, my, mz), (xx, xy, xz, yy, yz, zz))


@dataclass(frozen=True)
class Hydraulics:
    """The supply and the valves: what gives the chambers their back-pressure."""

    supply: float = 21.0e6  # Pa, at no flow
    tank: float = 0.3e6  # Pa
    preload: float = 0.42e6  # Pa above tank that a meter-out edge keeps at no flow
    head_floor: float = 0.27e6  # Pa above tank that anti-cavitation keeps in the inflow chamber
    loss: float = 9.0e7  # Pa s^2/m^2: drop over a meter-out edge per (flow / head area)^2
    droop: float = 1.5e9  # Pa s/m^3, supply pressure lost per flow
    ambient: float = 295.0  # K, oil at power-on
    heating: float = 18.0  # K, final rise of the oil
    warm_up: float = 900.0  # s, time constant of that rise


@dataclass(frozen=True)
class Truth:
    """Everything that the plant knows and a fit has to find."""

    links: tuple[LinkTruth, ...]
    cylinders: Mapping[str, CylinderTruth] = field(default_factory=dict)
    drives: Mapping[str, DriveTruth] = field(default_factory=dict)
    hydraulics: Hydraulics = field(default_factory=Hydraulics)

    def to_dict(self) -> dict[str, Any]:
        """Convert to plain lists and mappings, for YAML or JSON."""
        return {
            "cylinders": {name: asdict(cylinder) for name, cylinder in self.cylinders.items()},
            "drives": {name: asdict(drive) for name, drive in self.drives.items()},
            "links": [link.as_list() for link in self.links],
            "hydraulics": asdict(self.hydraulics),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Truth:
        """Invert :meth:`to_dict`; leave alone keys that are not the plant's (name, effects)."""
        return cls(
            links=tuple(LinkTruth.from_list([float(v) for v in link]) for link in content["links"]),
            cylinders={name: CylinderTruth(**c) for name, c in (content.get("cylinders") or {}).items()},
            drives={name: DriveTruth(**d) for name, d in (content.get("drives") or {}).items()},
            hydraulics=Hydraulics(**(content.get("hydraulics") or {})),
        )


def load_truth(path: str | Path) -> Truth:
    """Read plant parameters from YAML.

    Raises
    ------
    InputError
        If the file is not there or is no description of a plant.
    """
    path = Path(path)
    try:
        content = safe_yaml.read(path.read_text(encoding="utf-8"))[1]
        if not isinstance(content, dict) or "links" not in content:
            raise ValueError("no 'links'")
        return Truth.from_dict(content)
    except FileNotFoundError:
        raise InputError("sim_backends.no_truth_file", path=path) from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError) as error:
        what = " ".join(str(error).split())[:120]
        raise InputError("sim_backends.not_a_truth", path=path, error=what) from None


def truth_to_yaml(truth: Truth) -> str:
    """Write the truth as YAML; :func:`load_truth` reads it back unchanged."""
    return yaml.safe_dump(truth.to_dict(), sort_keys=False)


@dataclass(frozen=True)
class SensorQuality:
    """Quality of the measurement chain, and quiet of the machine. All of it is random, none of it declared.

    Standard deviations and resolutions are in SI units. ``disturbance`` and ``knock_size`` are relative to the
    cylinder's Coulomb friction, because seals and valves are what makes a cylinder restless; ``tracking`` is relative
    to the travel of the joint or piston.
    """

    encoder_std: float = 1.0e-5  # rad (or m for a prismatic joint)
    encoder_resolution: float = 2 * 3.141592653589793 / 2**20  # rad: a 20-bit single-turn encoder
    piston_std: float = 3.0e-6  # m
    piston_resolution: float = 5.0e-6  # m: a usual CiA 406 magnetostrictive transducer
    pressure_std: float = 1500.0  # Pa
    pressure_resolution: float = 25.0e6 / 2**16  # Pa: 16 bits over 250 bar
    effort_std: float = 0.2  # N m or N, of a joint_effort channel
    disturbance: float = 0.1  # standard deviation of the AR(1) force on every cylinder, over f_c
    disturbance_time: float = 0.15  # s, its correlation time
    knock_rate: float = 0.005  # 1/s per cylinder: rare force spikes
    knock_size: float = 0.8  # largest spike, over f_c
    tracking: float = 4.0e-5  # standard deviation of the controller's random tracking error, over the travel
    temperature_std: float = 0.05  # K

    @classmethod
    def perfect(cls) -> SensorQuality:
        """Return a chain without noise, steps, disturbance or tracking error: for checks against theory."""
        return cls(**{name: 0.0 for name in cls.__dataclass_fields__ if name != "disturbance_time"})
