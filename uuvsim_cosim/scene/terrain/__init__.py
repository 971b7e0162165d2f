"""A chart or a surveyed grid becomes a terrain, and a terrain becomes files.

It may import `scene.chart`, `scene.shared`. Start reading with `make.py`.
"""
