"""EDS files: the object dictionary of a device, read by the canopen package."""

from __future__ import annotations

import configparser
import io
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from canopen.objectdictionary import ObjectDictionary, ObjectDictionaryError, ODVariable
from canopen.objectdictionary.eds import import_eds

from teleop_rt.axis import AxisError
from teleop_rt_drivers.bounded_file import read_description
from teleop_rt_drivers.canopen import eds_file
from teleop_rt_drivers.canopen.entries import address

if TYPE_CHECKING:
    from teleop_rt_drivers.canopen.node_config import NodeConfig, PdoConfig

COB_ID_MASK = 0x7FF  # the 11 bits of an identifier; flags are above them


def load(name: str, node_id: int) -> ObjectDictionary:
    """Read the EDS `name`, a path or a file of this package; raises AxisError naming it."""
    path = Path(name)
    source = path if path.is_file() else resources.files("teleop_rt_drivers") / "eds" / name
    if not source.is_file():
        raise AxisError(
            f"EDS file {name!r} is neither a file nor one of this package's eds folder"
            ": check the path"
        )
    try:
        text = read_description(source, f"EDS file {name!r}").decode("utf-8")
        eds_file.check(text, name)
        dictionary: ObjectDictionary = import_eds(io.StringIO(text), node_id)  # type: ignore[no-untyped-call]
    except (configparser.Error, ValueError, KeyError, ObjectDictionaryError) as error:
        raise AxisError(
            f"EDS file {name!r} cannot be read: {error}: get it again from the device's maker"
        ) from error
    return dictionary


def variable(dictionary: ObjectDictionary, index: int, subindex: int) -> ODVariable:
    """Return an entry of the dictionary; raises KeyError when the device has none such."""
    found = dictionary.get_variable(index, subindex)
    if found is None:
        raise KeyError(f"{index:04X}h:{subindex}")
    return found


def cob_id(dictionary: ObjectDictionary, pdo: PdoConfig, communication: int) -> int:
    """Return the COB-ID of a PDO: the config's, or the default of the EDS."""
    if pdo.cob_id is not None:
        return pdo.cob_id
    default = variable(dictionary, communication + pdo.number - 1, 1).default
    if default is None:
        raise KeyError(f"default of {communication + pdo.number - 1:04X}h:1")
    return default & COB_ID_MASK


def check_against_config(dictionary: ObjectDictionary, node: NodeConfig, name: str) -> None:
    """Refuse an EDS that is of another device than the config says."""
    identity = node.identity
    expected = {1: identity.vendor, 2: identity.product, 3: identity.revision}
    for subindex, value in expected.items():
        entry = dictionary.get_variable(0x1018, subindex)
        found = None if entry is None else entry.default
        if value is not None and found not in (None, 0, value):
            raise AxisError(
                f"{name}: {node.eds} is of a device with {found:#x} in 1018h:{subindex}, "
                f"the rig's config says {value:#x}: name the right EDS or correct the identity"
            )


def describe_entry(entry: str, dictionary: ObjectDictionary) -> str:
    """Return an entry with its name in the EDS, for messages."""
    index, subindex = address(entry)
    found = dictionary.get_variable(index, subindex)
    return entry if found is None else f"{entry} ({found.name})"
