"""`uuvsim run` and what follows a run: compare, export, report, view, map, pack, systems.

It may import `commands.shared`. Start reading with `run.py`.
"""
