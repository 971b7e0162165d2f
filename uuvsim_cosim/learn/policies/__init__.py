"""Trained policies as data: tensors, observations, actions; numpy alone acts.

It may import nothing of `learn` beside it. Start reading with `policy.py`.
"""
