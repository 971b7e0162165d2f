"""Episodes of tasks: seeds, time limits, spaces; one agent or several.

It may import `envs.plants`, `envs.task`, `envs.pictures`. Start reading with `episodes.py`.
"""
