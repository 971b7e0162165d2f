"""Scenes: terrain, obstacles, other vehicles, and rays through them.

It may import `models.declaration`, `models.intrinsics`, `models.shapes`. Start reading with
`scene.py`.
"""
