"""The TCP server: frames of a JSON header and float64 numbers, for MATLAB, Octave and others.

It may import `bridge.calls`, `bridge.access`. Start reading with `server.py`.
"""
