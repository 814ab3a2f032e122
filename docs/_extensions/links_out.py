"""Links of the Markdown that lead out of ``docs/``: into the repository, where the site has no page.

In the repository they lead to a file or a folder. On the site the text of a link to Markdown or a folder stays, with
its path as a tooltip; other files are downloads. What is not there is left to MyST, which warns, and warnings are
errors.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform


class LinksOut(SphinxPostTransform):
    """Replaces links to files of the repository that are no pages."""

    default_priority = 5  # before MyST looks for targets

    def run(self, **kwargs: Any) -> None:
        """Look at every link that MyST left for later."""
        docs = Path(self.app.srcdir)
        for node in list(self.document.findall(addnodes.pending_xref)):
            target = unquote(str(node.get("reftarget", ""))).partition("#")[0]
            if node.get("refdomain") == "doc":  # a Markdown file; MyST gives those outside as a path without its suffix
                path = Path(f"{target}.md") if target.startswith("/") else docs
            else:
                path = (docs / Path(self.env.docname).parent / target).resolve()
            there = path.is_dir() if path.is_relative_to(docs) else path.exists()
            if there and path != docs:
                self._replace(node, path, docs)

    def _replace(self, node: nodes.Element, path: Path, docs: Path) -> None:
        root = docs.parent
        shown = path.relative_to(root) if path.is_relative_to(root) else path.name
        node.replace_self(nodes.inline("", "", *node.children, classes=["in-repository"], title=str(shown)))


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the transform."""
    app.add_post_transform(LinksOut)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
