"""Trials and rigs: their YAML files, the schema, and the messages about what is wrong in them."""
