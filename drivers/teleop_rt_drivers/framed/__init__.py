"""Devices that send frames with named fields: serial ports by YAML formats, raw CAN by DBC."""
