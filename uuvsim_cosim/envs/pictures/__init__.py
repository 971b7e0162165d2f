"""Rendered pictures of environments: canvas, plan view, depth strip, window.

It may import nothing of `envs` beside it. Start reading with `picture.py`.
"""
