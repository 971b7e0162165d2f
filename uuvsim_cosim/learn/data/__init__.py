"""Datasets: collected from policies, out of recordings, in Minari's form.

It may import `learn.training` and lower parts. Start reading with `dataset.py`.
"""
