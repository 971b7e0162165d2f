"""Parameters of a vehicle fitted to a recording.

It may import nothing of `studies` beside it. Start reading with `identify.py`.
"""
