"""Sphinx configuration: MyST Markdown, furo, warnings are errors."""

import os
import sys
from pathlib import Path

from uuvsim_cosim._version import __version__

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "uuvsim-cosim"
author = "The uuvsim-cosim maintainers"
release = version = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "reference_pages", "gallery", "live"]
autodoc_typehints_format = "short"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "NDArray"}
maximum_signature_line_length = 88
default_role = "literal"
add_module_names = False
toc_object_entries_show_parents = "hide"
html_theme = "furo"
html_title = "uuvsim-cosim"
html_static_path = ["_static"]
html_css_files = ["notebooks.css"]
exclude_patterns = ["_build", "**.ipynb_checkpoints"]
# Notebooks are stored without outputs and run here, each in an empty folder; an error in one ends
# the build. Their cells call `uuvsim` and `python` of this environment, activated or not.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_merge_streams = True
nb_execution_raise_on_error = True
nb_execution_timeout = -1
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence", "deflist"]
suppress_warnings: list[str] = []
