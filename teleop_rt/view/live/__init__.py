"""The live page: a run, a daemon or a recording in a browser (extra `live`)."""
