"""A run from start to end: load a system, simulate it into a folder; linearization and trim.

It may import every package of `orchestrator` except `shipped`. Start reading with `run.py`.
"""
