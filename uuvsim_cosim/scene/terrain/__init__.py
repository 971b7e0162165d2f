"""Terrains from charts and surveyed grids, and files of terrains.

It may import `scene.chart`, `scene.shared`. Start reading with `make.py`.
"""
