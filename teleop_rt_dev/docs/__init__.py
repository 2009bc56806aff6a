"""The documentation: generated pages, pictures and the notebook."""
