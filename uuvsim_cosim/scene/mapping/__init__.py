"""Maps of the seabed from runs.

It may import `scene.shared`. Start reading with `survey.py`.
"""
