"""The live page: a running session, or a recording, in a browser (extra `live`)."""
