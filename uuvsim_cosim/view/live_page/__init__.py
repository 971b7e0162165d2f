"""A system that runs in a browser: one file, without network access.

It may import the modules of `view.scene3d` and `view.plots`. Start reading with `live_page.py`.
"""
