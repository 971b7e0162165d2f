"""Common parts of `learn`: tasks by name, errors, extras, folders of files.

It may import `envs` and what lies below it, nothing of `learn`. Start reading with `task_ids.py`.
"""
