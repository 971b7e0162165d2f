"""Sources of models as BibTeX: the bibliography, and what a component cites.

Start with `component_sources.py`. Nothing in `models` imports it.
"""
