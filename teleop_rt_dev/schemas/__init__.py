"""The JSON Schemas that the shipped YAML files name."""
