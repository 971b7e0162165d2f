"""The commands that train, evaluate, show and export policies.

It may import the other groups of commands, and `commands.shared`. Start reading with `train.py`.
"""
