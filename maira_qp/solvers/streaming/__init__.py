"""Streaming: one target at a time, from a hand, a controller or another program that does not wait."""
