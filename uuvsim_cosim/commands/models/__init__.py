"""`uuvsim models`, `new`, `fmu`, `terrain`: vehicles, components, FMUs and terrains.

It may import `commands.shared`. Start reading with `models.py`.
"""
