"""Backends of environments: a fused kernel, masters in this process, or worker processes.

It may import `envs.task`, `envs.pictures`. Start reading with `plant.py`, then `choice.py`.
"""
