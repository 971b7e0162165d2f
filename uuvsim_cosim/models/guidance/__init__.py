"""Guidance: waypoints, paths, trajectories, pilots, targets.

It may import `models.control` and what is below it. Start reading with `line_of_sight.py`.
"""
