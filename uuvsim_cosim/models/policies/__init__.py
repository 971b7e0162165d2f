"""Trained policies as components.

It may import `models.guidance` and what is below it. Start reading with `policy.py`.
"""
