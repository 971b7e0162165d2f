"""A run in three dimensions: live pages, Foxglove, Rerun, the report's canvas.

It may import `view.plots`, `view.recorded`. Start reading with `scene.py`.
"""
