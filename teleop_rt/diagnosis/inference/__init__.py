"""Which effects explain the recording: screening, search, evidence and verdict."""
