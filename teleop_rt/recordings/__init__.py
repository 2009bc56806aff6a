"""Files of a recording, and the samples that they hold."""
