"""The session of a co-simulation: the thread that owns the master, lockstep, and playback.

It may import `bridge.calls`, `bridge.access`. Start reading with `conductor.py`.
"""
