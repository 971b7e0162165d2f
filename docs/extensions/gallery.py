"""Sphinx extension: the directive ``gallery`` shows notebooks as cards with their first plots.

    ```{gallery}
    first_run: A block diagram, figures of merit, plots and the report.
    ```

A line names a notebook of the same folder, and describes it. Title and picture of a card are those
of the executed notebook, so no picture is in git.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from docutils import nodes
from sphinx import addnodes
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

STYLE = """<style>
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem }
div.gallery .gallery-card { border: 1px solid var(--color-background-border); padding: .6rem }
.gallery-card img { width: 100%; aspect-ratio: 16/9; object-fit: contain; background: white }
.gallery-card a { font-weight: 600 }
.gallery-card p { margin: .4rem 0 0; font-size: .9em }
</style>"""


class Picture(nodes.General, nodes.Element):
    """Placeholder for title and picture of the notebook ``notebook``, until all are executed."""


class Gallery(SphinxDirective):
    """Cards of notebooks, one for each line of the content."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the cards, still without title and picture."""
        folder = self.env.docname.rpartition("/")[0]
        cards = nodes.container(classes=["gallery"])
        for line in filter(None, self.content):
            name, _, text = line.partition(": ")
            card = nodes.container(classes=["gallery-card"])
            card += Picture(notebook=f"{folder}/{name}")
            download = addnodes.download_reference(
                "", "Download", reftarget=f"{name}.ipynb", refdoc=self.env.docname
            )
            card += nodes.paragraph("", f"{text} ", download)
            cards += card
        self.env.metadata[self.env.docname]["gallery"] = "yes"
        return [nodes.raw("", STYLE, format="html"), cards]


def fill(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Replace each placeholder by a link with picture and title of its notebook."""
    for place in list(doctree.findall(Picture)):
        notebook = place["notebook"]
        to = {"refuri": app.builder.get_relative_uri(docname, notebook), "internal": True}
        images = app.env.get_doctree(notebook).findall(nodes.image)
        picture = next((i for i in images if i["uri"].endswith(".png")), None)
        if picture is None:
            raise ValueError(f"{notebook} draws no plot; expected one for its card in {docname}")
        title = app.env.titles[notebook].astext()
        picture = picture.deepcopy()
        picture["alt"] = title
        place.replace_self(
            [
                nodes.reference("", "", picture, **to),
                nodes.paragraph("", "", nodes.reference("", title, **to)),
            ]
        )


def again(_app: Sphinx, env: BuildEnvironment) -> Iterable[str]:
    """Return the pages with cards: they are written again when any notebook has changed."""
    return [name for name, about in env.metadata.items() if "gallery" in about]


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx."""
    app.add_node(Picture)
    app.add_directive("gallery", Gallery)
    app.connect("doctree-resolved", fill)
    app.connect("env-updated", again)
    return {"parallel_read_safe": True, "version": "1"}
