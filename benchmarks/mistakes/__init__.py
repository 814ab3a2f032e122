"""``hilfit bench mistakes``: mistakes that people make, made on random machines, and what the checks call them.

============  ================================================================================
rigs          random machines with both position sensors, with one, and of one joint
making        the mistakes, one function each, and what each should be called
running       all mistakes on all machines, sound machines beside them, numbers and targets
============  ================================================================================
"""

from benchmarks.mistakes.making import MISTAKES

__all__ = ["MISTAKES"]
