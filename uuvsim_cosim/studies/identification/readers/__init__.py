"""Readers of the logs of vehicles, one for each format, and channels that a user assigns."""
