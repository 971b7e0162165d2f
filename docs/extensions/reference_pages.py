"""Sphinx extension that writes the pages below ``docs/reference/`` before each build.

The pages of the API, of the components, of the environments and of the commands are generated from
the code, so they cannot differ from it. They are not in git. `api.py`, `components.py`,
`environments.py` and `commands.py` beside this file generate one folder each, as texts by file
name; a file whose text is as before is left, so that a second build is quick.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parent))

import api
import commands
import components
import environments

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDERS: dict[str, Callable[[], Mapping[str, str | bytes]]] = {
    "api": api.pages,
    "components": components.pages,
    "environments": environments.pages,
    "commands": commands.pages,
}


def write_pages(root: Path) -> None:
    """Write all generated pages below a folder, and delete those of names that are gone."""
    for name, pages in FOLDERS.items():
        folder = root / name
        folder.mkdir(parents=True, exist_ok=True)
        texts = pages()
        for file in folder.iterdir():
            if file.name not in texts:
                file.unlink()
        for file_name, text in texts.items():
            file = folder / file_name
            data = text if isinstance(text, bytes) else text.encode()
            if not file.is_file() or file.read_bytes() != data:
                file.write_bytes(data)


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx: pages are written before the sources are read."""
    logging.getLogger("uuvsim_cosim").setLevel(logging.WARNING)  # not each compilation
    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir) / "reference"))
    app.connect("autodoc-process-docstring", api.as_rst)
    app.connect("autodoc-process-signature", api.with_plain_types)
    return {"parallel_read_safe": True, "version": "1"}
