"""Emergency messages in words (CiA 301, table 26)."""

from __future__ import annotations

EXACT = {
    0x8110: "CAN overrun: frames were lost in the device",
    0x8120: "CAN error-passive",
    0x8130: "heartbeat of this daemon ended: it stood still, or the bus was interrupted",
    0x8140: "recovered from bus-off",
    0x8150: "collision of COB-IDs",
    0x8210: "a PDO was too short and was not used",
    0x8220: "a PDO was too long",
    0x8240: "SYNC has another length than configured (1019h)",
    0x8250: "a PDO that was expected did not come in time",
}
FAMILIES = {
    0x10: "generic error",
    0x20: "current",
    0x21: "current on the input side",
    0x22: "current inside the device",
    0x23: "current on the output side",
    0x30: "voltage",
    0x31: "mains voltage",
    0x32: "voltage inside the device",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "device temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x61: "internal software",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional modules",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "device specific: see its manual",
}
REGISTER_BITS = (
    "generic", "current", "voltage", "temperature", "communication", "profile", "reserved", "maker",
)  # fmt: skip


def emergency_in_words(node: str, data: bytes) -> str:
    """Return the 8 bytes of an emergency message in words: code, meaning, error register."""
    code = int.from_bytes(data[:2], "little")
    meaning = EXACT.get(code) or FAMILIES.get(code >> 8) or FAMILIES.get(code >> 8 & 0xF0)
    register = [name for bit, name in enumerate(REGISTER_BITS) if data[2] >> bit & 1]
    return (
        f"{node}: emergency {code:04X}h, {meaning or 'unknown'}; "
        f"error register: {', '.join(register) or 'empty'}; maker's bytes: {data[3:8].hex(' ')}"
    )
