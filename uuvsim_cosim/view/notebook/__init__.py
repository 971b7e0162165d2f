"""Display in notebooks: block diagrams, reports, figures of models, plots of signals, metrics.

`displays.py` is called by name from `System`, `Run` and `Model`, which are in lower packages. It
may import all of `view`. Start with `plot.py`.
"""
