"""Make the client's typed part before it is built; a source distribution has it already."""

import sys
from pathlib import Path

from setuptools import setup

sys.path.insert(0, str(Path(__file__).parent))

import generate

if generate.SOURCE.is_file():
    generate.main()
setup()
