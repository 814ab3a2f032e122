"""The results of the demonstrations in README.md, as the commands print them.

``make readme`` runs ``hilfit demo`` and ``hilfit demo --valve`` in temporary folders and puts what they print there.
``hilfit bench demo`` runs the first again and compares the numbers, a test words and numbers.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from tempfile import TemporaryDirectory

README = Path(__file__).parents[1] / "README.md"
_BLOCK = re.compile(r"(?<=^```\n)acquired .*?(?=^```$)", re.MULTILINE | re.DOTALL)
_VALVES = re.compile(r"(?<=^```\n) +error over the speed's RMS.*?(?=^```$)", re.MULTILINE | re.DOTALL)
_WIDTH = 120


def printed_result() -> str:
    """Return the block of README.md."""
    (found,) = _BLOCK.findall(README.read_text(encoding="utf-8"))
    return str(found)


def said_by_the_demo(printed: str) -> str:
    """Extract from ``hilfit demo``'s output what was acquired, the first table, and the verdict."""
    lines = printed.splitlines()
    first = lines[: next(number for number, line in enumerate(lines) if line.startswith("└")) + 1]
    (verdict,) = (line for line in lines if line.startswith("The model lacked"))
    return "\n".join(line.rstrip() for line in (*first, *textwrap.wrap(verdict, _WIDTH))) + "\n"


def said_of_valves(printed: str) -> str:
    """Extract from ``hilfit demo --valve``'s output errors, findings, and the self-tests."""
    lines = printed.splitlines()
    first = next(number for number, line in enumerate(lines) if "error over the speed's RMS" in line)
    return "\n".join(line.rstrip() for line in lines[first:] if not line.startswith("report:")) + "\n"


def numbers(result: str) -> list[float]:
    """Read each joint's noise floor and errors before and after, in the order of the table."""
    rows = re.findall(r"^│ \w+ +│ N m +│ ([\d.]+) +│ ([\d.]+) +│ ([\d.]+) +│", result, re.MULTILINE)
    return [float(number) for row in rows for number in row]


def main() -> None:
    """Run the demonstrations and write their results into README.md."""
    for more, block, extract in (([], _BLOCK, said_by_the_demo), (["--valve"], _VALVES, said_of_valves)):
        with TemporaryDirectory(prefix="hilfit-readme-") as folder:
            command = [sys.executable, "-m", "server.commands.command_line", "demo", *more]
            environment = {**os.environ, "COLUMNS": "80"}
            done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True, env=environment)
        result = extract(done.stdout)
        text = README.read_text(encoding="utf-8")
        README.write_text(block.sub(lambda _, result=result: result, text), encoding="utf-8")  # type: ignore[misc]
        print(result, end="")


if __name__ == "__main__":
    main()
