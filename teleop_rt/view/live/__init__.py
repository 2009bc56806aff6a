"""The live page: what a running session, or a recording, shows in a browser (extra `live`)."""
