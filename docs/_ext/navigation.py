"""The tree of pages beside each page, made once instead of anew for each page.

The theme lets Sphinx resolve all entries for every page, and parses the result; that took half of
the time of a build.  The trees of two pages differ in the links, which are relative, and in the
marks of the page and of what it is below.  Those of some pages are compared with the theme's.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from bs4 import BeautifulSoup, Tag
from furo.navigation import get_navigation_tree
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.osutil import relative_uri

#: The pages whose trees are compared: in a folder, and below another page.
COMPARED = "tutorials/"
LOG = logging.getLogger(__name__)


class Navigation:
    """The tree with the links of the first page, which is not in it.

    Parameters
    ----------
    tree : str
        HTML of the theme.
    """

    def __init__(self, tree: str) -> None:
        self._soup = BeautifulSoup(tree, "html.parser")
        self._links = [(link, link["href"]) for link in self._soup.find_all("a")]

    def beside(self, uri: str) -> str:
        """Return the tree for the page at this address."""
        marked: list[tuple[Tag, Any]] = []
        for link, target in self._links:
            link["href"] = relative_uri(uri, target) or "#"
            if target == uri:
                self._mark(link, marked)
        tree = str(self._soup)
        for tag, attributes in reversed(marked):
            tag.attrs = attributes
        return tree

    @staticmethod
    def _mark(link: Tag, marked: list[tuple[Tag, Any]]) -> None:
        """Mark a link and what it is in, and add these with their attributes to the list."""
        above = [tag for tag in link.parents if tag.name in ("li", "ul")]
        marked += [(tag, dict(tag.attrs)) for tag in (link, *above)]
        link["class"] = ["current", *link["class"]]
        for tag in above:
            classes = tag.get("class", [])
            tag["class"] = [*classes[:1], "current", *classes[1:]]
            box = tag.find("input", recursive=False)
            if box is not None:
                marked.append((box, dict(box.attrs)))
                box["checked"] = ""
        above[0]["class"] = [*above[0]["class"], "current-page"]


@cache  # in each of the processes that write pages
def _navigation(app: Sphinx) -> Navigation:
    return Navigation(get_navigation_tree(_entries(app, app.config.root_doc)))


def _entries(app: Sphinx, page: str) -> str:
    """Return what the theme asks Sphinx for, which gives it to the page being written only."""
    options = {"collapse": False, "titles_only": True, "maxdepth": -1, "includehidden": True}
    return str(app.builder._get_local_toctree(page, **options))  # type: ignore[attr-defined]


def hide_entries(app: Sphinx, page: str, template: str, context: dict[str, Any], _: Any) -> None:
    """Leave the theme nothing to make a tree of."""
    context["entries"] = context.pop("toctree", None)


def add_navigation(app: Sphinx, page: str, template: str, context: dict[str, Any], _: Any) -> None:
    """Give a page its tree."""
    context["toctree"] = context.pop("entries")
    tree = _navigation(app).beside(app.builder.get_target_uri(page))
    if page.startswith(COMPARED) and tree != get_navigation_tree(_entries(app, page)):
        LOG.warning("%s: the tree of pages is not the one of the theme", page)
    context["furo_navigation_tree"] = tree


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx, before and after the theme."""
    app.connect("html-page-context", hide_entries, priority=400)
    app.connect("html-page-context", add_navigation, priority=600)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
