"""Drives with protocols of their makers: pure codecs, and one port that speaks any of them."""
