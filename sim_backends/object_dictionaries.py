"""Object dictionaries of the simulated CANopen devices: an EDS per kind, fitted to what a machine file expects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import canopen
from canopen import objectdictionary
from canopen.objectdictionary import ODRecord, ODVariable

from sim_backends.device_plans import NodePlan

_TYPES = {
    "int8": objectdictionary.INTEGER8, "int16": objectdictionary.INTEGER16, "int32": objectdictionary.INTEGER32,
    "int64": objectdictionary.INTEGER64, "uint8": objectdictionary.UNSIGNED8, "uint16": objectdictionary.UNSIGNED16,
    "uint32": objectdictionary.UNSIGNED32, "uint64": objectdictionary.UNSIGNED64,
    "float32": objectdictionary.REAL32, "float64": objectdictionary.REAL64,
}  # fmt: skip


def object_dictionary(plan: NodePlan) -> Any:
    """The device's EDS, with the objects and the identity that the machine file expects."""
    path = Path(__file__).parent / "eds" / f"{plan.kind}.eds"
    dictionary = canopen.import_od(str(path), plan.node)
    if plan.device_type is not None:
        dictionary[0x1000].default = plan.device_type
    if plan.vendor_id is not None:
        dictionary[0x1018][1].default = plan.vendor_id
    if plan.product_code is not None:
        dictionary[0x1018][2].default = plan.product_code
    for item in plan.objects:
        entry = dictionary.get(item.index)
        variable = entry if isinstance(entry, ODVariable) else (entry or {}).get(item.subindex)
        if variable is None:
            variable = ODVariable(item.signal.channel, item.index, item.subindex)
            if item.subindex == 0 and entry is None:
                dictionary.add_object(variable)
            else:
                if entry is None:
                    entry = ODRecord(item.signal.channel, item.index)
                    highest = ODVariable("Highest sub-index supported", item.index, 0)
                    highest.data_type, highest.access_type, highest.default = objectdictionary.UNSIGNED8, "ro", 0
                    entry.add_member(highest)
                    dictionary.add_object(entry)
                entry.add_member(variable)
                entry[0].default = max(entry[0].default or 0, item.subindex)
        variable.data_type = _TYPES[item.signal.data_type]
        variable.access_type = "ro"
        variable.pdo_mappable = True
        variable.default = 0
    return dictionary
