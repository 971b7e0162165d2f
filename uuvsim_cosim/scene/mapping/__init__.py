"""A run becomes a map of the seabed.

It may import `scene.shared`. Start reading with `survey.py`.
"""
