"""The Python clients, remote components, and the FMU of a running co-simulation.

It may import every other part of `bridge`. Start reading with `client.py`.
"""
