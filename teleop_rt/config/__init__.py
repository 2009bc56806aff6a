"""Trials and rigs: their YAML files, the schema, and the messages about their mistakes."""
