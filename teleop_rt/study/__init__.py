"""The studies of the report and beyond, repeatable."""
