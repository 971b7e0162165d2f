"""`uuvsim models`, `new`, `fmu`, `terrain`: vehicles, components and what is built of them.

It may import `commands.shared`. Start reading with `models.py`.
"""
