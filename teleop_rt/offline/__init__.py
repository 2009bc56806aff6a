"""Off-line work on recordings: replay and diagnosis of files."""
