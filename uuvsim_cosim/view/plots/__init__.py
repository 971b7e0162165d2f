"""Panels over time, tracks, pixels: the small plotting library of the reports.

It may import `view.recorded`. Start reading with `plots.py`.
"""
