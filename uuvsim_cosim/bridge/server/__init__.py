"""The thread that owns the master and carries out what clients ask for; lockstep; playback.

It may import `bridge.calls`, `bridge.access`. Start reading with `conductor.py`.
"""
