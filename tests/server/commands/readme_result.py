"""The result of the demonstration on the first screen of README.md, as the command prints it.

``make readme`` runs ``hilfit demo`` in a temporary folder and puts what it says into README.md. A test runs it again
and compares.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from tempfile import TemporaryDirectory

README = Path(__file__).parents[3] / "README.md"
_BLOCK = re.compile(r"(?<=^```\n)acquired .*?(?=^```$)", re.MULTILINE | re.DOTALL)
_WIDTH = 120


def printed_result() -> str:
    """The block of README.md."""
    (found,) = _BLOCK.findall(README.read_text(encoding="utf-8"))
    return str(found)


def said_by_the_demo(printed: str) -> str:
    """Of all that ``hilfit demo`` prints: what was acquired, the first table, and the verdict."""
    lines = printed.splitlines()
    first = lines[: next(number for number, line in enumerate(lines) if line.startswith("└")) + 1]
    (verdict,) = (line for line in lines if line.startswith("The model lacked"))
    return "\n".join(line.rstrip() for line in (*first, *textwrap.wrap(verdict, _WIDTH))) + "\n"


def numbers(result: str) -> list[float]:
    """Of each joint the noise floor and the errors before and after, in the order of the table."""
    rows = re.findall(r"^│ \w+ +│ N m +│ ([\d.]+) +│ ([\d.]+) +│ ([\d.]+) +│", result, re.MULTILINE)
    return [float(number) for row in rows for number in row]


def main() -> None:
    """Run the demonstration and write its result into README.md."""
    with TemporaryDirectory(prefix="hilfit-readme-") as folder:
        command = [sys.executable, "-m", "server.commands.command_line", "demo"]
        environment = {**os.environ, "COLUMNS": "80"}
        done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    result = said_by_the_demo(done.stdout)
    README.write_text(_BLOCK.sub(lambda _: result, README.read_text(encoding="utf-8")), encoding="utf-8")
    print(result, end="")


if __name__ == "__main__":
    main()
