"""A training and a curriculum: configuration, rollout, evaluation, files.

It may import `learn.algorithms`, `learn.policies`, `learn.shared`. Start reading
with `train.py`, then `training.py`.
"""
