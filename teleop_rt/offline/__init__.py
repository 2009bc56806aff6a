"""What is done with recordings after the fact: replay and diagnosis of files."""
