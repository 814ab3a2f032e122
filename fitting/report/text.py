"""Numbers and names as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import Any

_MINUS = "\u2212"
_SUPERSCRIPT = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
# Not from the locale: the same report has to give the same page everywhere.
MONTHS = (
    "January", "February", "March", "April", "May", "June", "July", "August", "September", "October", "November",
    "December",
)  # fmt: skip
#: Units that people use in a sentence in the place of SI's: factor, and how it is written behind the number.
USUAL = {
    "m": (1e3, " mm"),
    "m/s": (1e3, " mm/s"),
    "rad": (180.0 / math.pi, "\u00b0"),
    "rad/s": (180.0 / math.pi, "\u00b0/s"),
    "Pa": (1e-6, " MPa"),
}
#: What is written where a number does not exist.
NONE = "\u2013"
_ALL_DIGITS = Context(prec=800)  # no rounding but the one that is asked for, of any double


def _to_place(value: float, place: int) -> Decimal:
    """Round ``value`` to whole ``10^place``; exact halves away from zero, like browsers and so the page."""
    return Decimal(value).quantize(Decimal(1).scaleb(place), ROUND_HALF_UP, _ALL_DIGITS)


def fixed(value: float, decimals: int) -> str:
    """Write so many decimals; fewer than none: zeros before the point."""
    rounded = _to_place(value, -decimals)
    whole, dot, rest = f"{abs(rounded):f}".partition(".")
    if len(whole) > 4:
        # A thin space (no-break) between groups of three, as ISO 80000-1 has it.
        whole = f"{int(whole):,}".replace(",", "\u202f")
    return f"{_MINUS if rounded < 0 else ''}{whole}{dot}{rest}"


def _exponent(value: float) -> int:
    return Decimal(value).adjusted() if value else 0


def _rounded(value: float, digits: int) -> tuple[float, int]:
    """Round to significant digits, and return the exponent of ten after that."""
    rounded = _to_place(value, _exponent(value) - digits + 1)
    return float(rounded), rounded.adjusted()


def number(value: float | None, digits: int = 3) -> str:
    """Write ``value`` to so many significant digits: ``0.0123``, ``45.6``, ``12 300``, ``1.23 x 10^7``."""
    if value is None or not math.isfinite(value):
        return NONE
    if value == 0:
        return "0"
    rounded, exponent = _rounded(value, digits)
    if -4 <= exponent <= 5:
        return fixed(rounded, digits - 1 - exponent)
    return f"{fixed(rounded / 10.0**exponent, digits - 1)}\u202f{scientific(exponent)}"


def scientific(exponent: int) -> str:
    """Write ``x 10^7`` with the usual signs."""
    return f"\u00d7\u202f10{str(exponent).translate(_SUPERSCRIPT)}"


def with_std(value: float | None, std: float | None) -> str:
    """Write ``7.13 ± 0.42``: the deviation in two significant digits, the value to its place.

    A deviation far larger than the value leaves the value at two digits of the deviation: that is what is known.
    """
    if value is None or not math.isfinite(value):
        return NONE
    if std is None or not math.isfinite(std) or std <= 0:
        return number(value, 4)
    rounded, place = _rounded(std, 2)
    top = max(_exponent(value), place)
    if -4 <= top <= 5:
        return f"{fixed(value, 1 - place)} \u00b1 {fixed(rounded, 1 - place)}"
    scale, decimals = 10.0**top, 1 - place + top
    return f"({fixed(value / scale, decimals)} \u00b1 {fixed(rounded / scale, decimals)})\u202f{scientific(top)}"


def percent(value: float | None) -> str:
    """Write a signed percentage: ``−74 %``; one decimal below ten."""
    if value is None or not math.isfinite(value):
        return NONE
    decimals = 0 if abs(value) >= 10 else 1
    text = fixed(value, decimals)
    plus = "+" if value > 0 and any(digit in "123456789" for digit in text) else ""
    return f"{plus}{text}\u202f%"


def share(value: float | None) -> str:
    """Write a part of one in percent, without a sign of its own: ``3.12 %``."""
    return NONE if value is None or not math.isfinite(value) else f"{number(100.0 * value)}\u202f%"


def change(before: float | None, after: float | None) -> float | None:
    """Compute the change in percent of ``before``; None where there is none."""
    if before is None or after is None or not before:
        return None
    return 100.0 * (after - before) / before


def ratio(value: float | None, base: float | None) -> float | None:
    """Compute ``value / base``; None where there is none."""
    return None if value is None or not base else value / base


def relative_std(value: float | None, std: float | None) -> float | None:
    """Compute the relative standard deviation in percent; None without either or at zero value."""
    return None if value is None or std is None or not value else abs(100.0 * std / value)


def moved(value: float | None) -> str:
    """Word a change in percent: ``fell by {}``, ``rose by {}``, ``did not change``, ``is not known``."""
    if value is None or not math.isfinite(value):
        return "is not known"
    if f"{value:.1f}" in ("0.0", "-0.0"):
        return "did not change"
    return "fell by {}" if value < 0 else "rose by {}"


def moment(stamp: str, months: Sequence[str] = MONTHS, date: str = "{day} {month} {year}") -> str:
    """Write ``2026-03-02T09:14:05Z`` as ``2 March 2026, 09:14 UTC``; others as they are."""
    try:
        time = datetime.fromisoformat(stamp)
    except ValueError:
        return stamp
    zone = f" {time.tzname()}" if time.tzinfo is not None else ""
    day = date.format(day=time.day, month=months[time.month - 1], year=time.year)
    return f"{day}, {time:%H:%M}{zone}"


def unit(text: Any) -> str:
    """Write a unit with real exponents: ``kg m^2`` as ``kg m²``; nothing for a plain number."""
    out = "" if text in (None, "1") else str(text).replace("^(1/3)", "\u00b9\u2044\u00b3")
    for power in "23456":
        out = out.replace(f"^{power}", power.translate(_SUPERSCRIPT))
    return out
