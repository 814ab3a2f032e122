"""The commands of identification."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Files = list[Path] | None
Columns = Annotated[
    Path | None,
    typer.Option("--map", help="YAML file: which column of the recordings is which channel (channel: column)."),
]
Resample = Annotated[
    bool, typer.Option("--resample", help="Bring recordings of another rate to the machine's; the report says so.")
]
