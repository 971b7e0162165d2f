"""`uuvsim serve`, `uuvsim access` and `uuvsim matlab`.

It may import `commands.shared`. Start reading with `serve.py`.
"""
