"""Sphinx configuration: MyST Markdown, furo, warnings are errors."""

from uuvsim_cosim._version import __version__

project = "uuvsim-cosim"
author = "The uuvsim-cosim maintainers"
release = version = __version__
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "uuvsim-cosim"
exclude_patterns = ["_build"]
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence", "deflist"]
suppress_warnings: list[str] = []
