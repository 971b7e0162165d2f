"""What a task is: names of signals, observations, rewards, ends; and functions as tasks.

It may import `envs.pictures`. Start reading with `task.py`.
"""
