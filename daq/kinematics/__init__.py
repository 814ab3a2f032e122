"""Kinematics from other programs' files: a serial chain of axes, and its Denavit-Hartenberg table.

``chain``: axes in space. ``urdf`` and ``mjcf`` read them, ``table`` turns them into rows, ``draft`` writes the file.
"""

from daq.kinematics.chain import Axis, Chain
from daq.kinematics.draft import draft_machine, read_chain
from daq.kinematics.table import Table, table_of

__all__ = ["Axis", "Chain", "Table", "draft_machine", "read_chain", "table_of"]
