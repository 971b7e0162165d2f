"""Recorded images of sonars: as arrays, as pictures, and as files of other programs.

Start with `scans.py`.
"""
