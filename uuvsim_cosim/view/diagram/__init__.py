"""A system as a block diagram.

It may import nothing of `view` beside it. Start reading with `diagram.py`.
"""
