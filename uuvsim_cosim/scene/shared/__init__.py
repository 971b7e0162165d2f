"""Shared parts of `scene`: ray casting, and the libraries of the extra `scene`.

It may import nothing of `scene` beside it. Start reading with `ray_casting.py`.
"""
