"""The bus check as one page to print: a self-contained HTML file."""

from __future__ import annotations

import math
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from daq.commissioning.check import MachineCheck


def check_page(check: MachineCheck) -> str:
    """The page."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template("check_page.html.j2").render(check=check, number=number)


def number(value: float, digits: int = 4) -> str:
    """A number with so many digits; empty where there is none."""
    return "" if math.isnan(value) else f"{value:.{digits}g}"
