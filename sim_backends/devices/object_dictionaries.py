"""Object dictionaries of the simulated CANopen devices: an EDS per kind, fitted to what a machine file expects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import canopen
from canopen import objectdictionary
from canopen.objectdictionary import ODRecord, ODVariable

from sim_backends.devices.device_plans import NodePlan

_TYPES = {
    "int8": objectdictionary.INTEGER8, "int16": objectdictionary.INTEGER16, "int32": objectdictionary.INTEGER32,
    "int64": objectdictionary.INTEGER64, "int24": objectdictionary.INTEGER24, "uint24": objectdictionary.UNSIGNED24,
    "uint8": objectdictionary.UNSIGNED8, "uint16": objectdictionary.UNSIGNED16,
    "uint32": objectdictionary.UNSIGNED32, "uint64": objectdictionary.UNSIGNED64,
    "float32": objectdictionary.REAL32, "float64": objectdictionary.REAL64,
}  # fmt: skip


DECIMALS = 2  # that a device reports where its EDS has no object for them
_NAMES = {number: name for name, number in _TYPES.items()}


def type_name(data_type: int) -> str | None:
    """Return the name of a number's data type (CiA 301, 7.4.7); None for what is no number."""
    return _NAMES.get(data_type)


def object_dictionary(plan: NodePlan) -> Any:
    """Load the device's EDS, with the objects and the identity that the machine file expects."""
    path = Path(__file__).parent / "eds" / f"{plan.kind}.eds"
    dictionary = canopen.import_od(str(path), plan.node)
    if plan.device_type is not None:
        dictionary[0x1000].default = plan.device_type
    if plan.vendor_id is not None:
        dictionary[0x1018][1].default = plan.vendor_id
    if plan.product_code is not None:
        dictionary[0x1018][2].default = plan.product_code
    for subindex, known in ((3, plan.revision_number), (4, plan.serial_number)):
        if known is not None:
            dictionary[0x1018][subindex].default = known
    if plan.firmware is not None:
        dictionary[0x100A].default = plan.firmware
    for item in plan.objects:
        variable = _variable(dictionary, item.signal.channel, item.index, item.subindex)
        variable.data_type = _TYPES[item.signal.data_type]
        variable.access_type = "ro"
        variable.pdo_mappable = True
        variable.default = 0
        if item.signal.decimals is not None:
            variable = _variable(dictionary, f"decimals of {item.signal.channel}", *item.signal.decimals)
            variable.data_type, variable.access_type = objectdictionary.UNSIGNED8, "rw"
            variable.default = variable.default or DECIMALS
    return dictionary


def _variable(dictionary: Any, name: str, index: int, subindex: int) -> Any:
    """Return an object of the dictionary, made if it is not there."""
    entry = dictionary.get(index)
    variable = entry if isinstance(entry, ODVariable) else (entry or {}).get(subindex)
    if variable is not None:
        return variable
    variable = ODVariable(name, index, subindex)
    if subindex == 0 and entry is None:
        dictionary.add_object(variable)
        return variable
    if entry is None:
        entry = ODRecord(name, index)
        highest = ODVariable("Highest sub-index supported", index, 0)
        highest.data_type, highest.access_type, highest.default = objectdictionary.UNSIGNED8, "ro", 0
        entry.add_member(highest)
        dictionary.add_object(entry)
    entry.add_member(variable)
    entry[0].default = max(entry[0].default or 0, subindex)
    return variable
