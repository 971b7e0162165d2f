"""Definition of a task: names of signals, observations, rewards, ends; tasks from functions.

It may import `envs.pictures`. Start reading with `task.py`.
"""
