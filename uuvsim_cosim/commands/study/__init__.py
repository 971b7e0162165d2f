"""`uuvsim study` and `uuvsim identify`.

It may import `commands.shared`. Start reading with `study.py`.
"""
