"""Identification of a vehicle's parameters from a recording.

It may import nothing of `studies` beside it. Start reading with `identify.py`.
"""
