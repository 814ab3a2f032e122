"""Units at the edges: channels declare units from a closed list, pint converts them, everything inside is SI.

Units stand in files from anybody, and pint evaluates what it is given: ``rad*9**9**9`` is a number that no memory
holds. So it is only given products of known names with exponents of one digit.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.arrays import FloatArray
from daq.errors import BadValueError

SI_UNITS: dict[str, str] = {
    "joint_position": "rad",
    "joint_velocity": "rad/s",
    "piston_position": "m",
    "head_pressure": "Pa",
    "rod_pressure": "Pa",
    "cylinder_force": "N",
    "joint_effort": "N m",
    "motor_position": "rad",
    "motor_velocity": "rad/s",
    "motor_effort": "N m",
    "external_force": "N",
    "oil_temperature": "K",
    "supply_pressure": "Pa",
    "tank_pressure": "Pa",
    "base_roll": "rad",
    "base_pitch": "rad",
    "command": "1",  # as it is sent, see AS_SENT
    "spool_position": "1",  # as it is sent
    "head_port_pressure": "Pa",
    "rod_port_pressure": "Pa",
}
#: Of a joint that slides.
_STRAIGHT = {"joint_position": "m", "joint_velocity": "m/s", "joint_effort": "N"}
#: Units of what is kept as an amplifier takes or gives it: nothing is converted.
AS_SENT = ("1", "%", "V", "mV", "A", "mA", "mm", "count")

#: Factor and offset of the units of most machine files, as pint has them. Loading pint takes each process that reads
#: one 0.2 s of processor time.
USUAL: dict[tuple[str, str], tuple[float, float]] = {
    ("deg", "rad"): (math.pi / 180, 0.0),
    ("deg/s", "rad/s"): (math.pi / 180, 0.0),
    ("mm", "m"): (1e-3, 0.0),
    ("cm", "m"): (1e-2, 0.0),
    ("mm/s", "m/s"): (1e-3, 0.0),
    ("bar", "Pa"): (1e5, 0.0),
    ("kPa", "Pa"): (1e3, 0.0),
    ("MPa", "Pa"): (1e6, 0.0),
    ("kN", "N"): (1e3, 0.0),
    ("kN m", "N m"): (1e3, 0.0),
    ("degC", "K"): (1.0, 273.15),
    ("°C", "K"): (1.0, 273.15),
}

_SHORT_PREFIXES = ("", *"nuµμmcdhkMG")
_LONG_PREFIXES = ("", "nano", "micro", "milli", "centi", "deci", "hecto", "kilo", "mega", "giga")
_SYMBOLS = ("m", "rad", "Pa", "bar", "N", "J", "W", "g", "s", "K", "gf", "dyn")
_WORDS = ("meter", "metre", "radian", "pascal", "bar", "newton", "joule", "gram", "second", "kelvin", "pond")
_OTHERS = """
    in inch inches ft foot feet yd yard thou micron min minute h hour hr
    deg degree degrees ° turn turns cycle revolution grad gon arcmin arcminute arcsec arcsecond
    lb pound lbf pound_force force_pound ozf kip kgf kilogram_force force_kilogram tf ton_force dyne
    rpm revolutions_per_minute hertz Hz rps
    psi ksi pound_force_per_square_inch atm atmosphere standard_atmosphere at technical_atmosphere torr
    mmHg inHg cmH2O mH2O inH2O Ba barye ft_lb foot_pound
    degC celsius degreeC degree_Celsius °C degF fahrenheit degreeF degree_Fahrenheit °F degR rankine
"""
#: All names that a unit may be made of: lengths, angles, forces, pressures, temperatures, and what those consist of.
NAMES = frozenset(
    [prefix + name for name in _SYMBOLS for prefix in _SHORT_PREFIXES]
    + [prefix + name + plural for name in _WORDS for prefix in _LONG_PREFIXES for plural in ("", "s")]
    + _OTHERS.split()
)
#: Factors of a unit; ``kg m^2 / s^2 / rad`` has four.
MOST_FACTORS = 6
_WORD = r"[A-Za-zµμ°][A-Za-z0-9_]*"
_EXPONENT = r"(?:\s*(?:\*\*|\^)\s*-?[1-4](?![0-9.])|[⁻]?[¹²³⁴]|\s+(?:squared|cubed))?"
_FACTOR = rf"\(?\s*(?:(?:square|cubic|sq)\s+)?{_WORD}{_EXPONENT}\s*\)?"
_EXPRESSION = re.compile(
    rf"(?:1\s*/\s*)?{_FACTOR}(?:(?:\s*[*/·.]\s*|\s+per\s+|\s+|(?<=\))){_FACTOR}){{0,{MOST_FACTORS - 1}}}"
)
_OPERATORS = frozenset(("per", "squared", "cubed", "square", "cubic", "sq"))
_LONGEST = 60


def si_unit(quantity: str, *, straight: bool = False) -> str:
    """Return the SI unit of a quantity, also of a prismatic (``straight``) joint."""
    return _STRAIGHT.get(quantity, SI_UNITS[quantity]) if straight else SI_UNITS[quantity]


def is_known(unit: str) -> bool:
    """Return whether a unit is known: a product of :data:`NAMES` with exponents up to 4."""
    text = unit.strip()
    if len(text) > _LONGEST or _EXPRESSION.fullmatch(text) is None:
        return False
    return all(word in NAMES or word in _OPERATORS for word in re.findall(_WORD, text))


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


@dataclass(frozen=True)
class Conversion:
    """Affine conversion into SI: ``si = factor * value + offset``."""

    factor: float
    offset: float

    def to_si(self, values: npt.ArrayLike) -> FloatArray:
        """Convert values in the declared unit to SI."""
        return self.factor * np.asarray(values, dtype=float) + self.offset

    def from_si(self, values: npt.ArrayLike) -> FloatArray:
        """Convert SI values to the declared unit."""
        return (np.asarray(values, dtype=float) - self.offset) / self.factor


def kept_as_sent(unit: str) -> Conversion:
    """Return the identity, of a command or a spool position; ValueError unless in :data:`AS_SENT`."""
    if unit not in AS_SENT:
        raise BadValueError("daq.no_unit_command", value=unit[:_LONGEST], as_sent=", ".join(AS_SENT))
    return Conversion(factor=1.0, offset=0.0)


@lru_cache(maxsize=256)
def conversion(unit: str, si_unit: str) -> Conversion:
    """Return the conversion from ``unit`` to ``si_unit``.

    Raises
    ------
    ValueError
        If the unit is none of the closed list (:func:`is_known`), or it measures something else.
    """
    if unit == si_unit:
        return Conversion(factor=1.0, offset=0.0)
    if (unit, si_unit) in USUAL:
        return Conversion(*USUAL[unit, si_unit])
    if not is_known(unit):
        raise BadValueError("daq.unknown_unit", unit=unit[:_LONGEST], si_unit=si_unit)
    import pint

    registry = _registry()
    try:
        zero = float(registry.Quantity(0.0, unit).to(si_unit).magnitude)
        one = float(registry.Quantity(1.0, unit).to(si_unit).magnitude)
    except pint.DimensionalityError:
        raise BadValueError("daq.unit_cannot_turned_into", unit=unit, si_unit=si_unit) from None
    except Exception:  # its parser raises whatever Python's tokenizer or an assertion makes of the text
        raise BadValueError("daq.unknown_unit", unit=unit, si_unit=si_unit) from None
    return Conversion(factor=one - zero, offset=zero)
