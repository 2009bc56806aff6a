"""The link between slave and master: messages, authenticated channel, impairment."""
