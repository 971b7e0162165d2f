"""Sphinx configuration: MyST Markdown, furo, warnings are errors."""

import sys
from pathlib import Path

from uuvsim_cosim._version import __version__

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "uuvsim-cosim"
author = "The uuvsim-cosim maintainers"
release = version = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "reference_pages"]
autodoc_typehints_format = "short"
maximum_signature_line_length = 88
default_role = "literal"
add_module_names = False
toc_object_entries_show_parents = "hide"
html_theme = "furo"
html_title = "uuvsim-cosim"
exclude_patterns = ["_build", "**.ipynb_checkpoints"]
# Notebooks are stored without outputs and run here; an error in one ends the build.
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = -1
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence", "deflist"]
suppress_warnings: list[str] = []
