"""The claims that hilfit began with, made again in kind: counts, cylinders, errors, friction, two stages.

``runs`` computes, ``page`` draws and writes. Nothing on the page is typed: numbers and verdicts are the runs'.
"""

from benchmarks.paper.page import run

__all__ = ["run"]
