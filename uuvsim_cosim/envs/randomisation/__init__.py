"""Domain randomisation: parameters drawn for every episode.

It may import `envs.task`, `envs.pictures`. Start reading with `randomisation.py`.
"""
