"""Sphinx configuration of the documentation site; `rover docs` builds it.

The pages are plain Markdown, readable on a Git host. Everything else that a site needs is added
here while the pages are read: the navigation, the reference of the Python API, drawn diagrams.
"""

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

project = "Rover executive"
release = tomllib.loads((HERE.parents[1] / "pyproject.toml").read_text())["project"]["version"]
version = release

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "diagrams"]
root_doc = "README"
include_patterns = ["*.md", "docs/*.md", "docs/site/*.md"]
PACKAGES = ("adapters", "config", "executive", "sim", "tests", "trees")
for package in PACKAGES:
    include_patterns += [f"{package}/README.md", f"{package}/**/README.md"]
exclude_patterns = [".*", "build", "dist", "install", "log", "runs", "changelog.d"]

myst_heading_anchors = 4
myst_enable_extensions = ["html_image"]

autodoc_typehints_format = "short"
autodoc_member_order = "alphabetical"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_rtype = False
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = project
html_static_path = ["style.css"]
html_css_files = ["style.css"]
html_copy_source = False
html_show_sphinx = html_show_copyright = False
html_search_scorer = str(HERE / "scorer.js")
templates_path = ["templates"]
html_sidebars = {
    "**": [
        "sidebar/brand.html",
        "versions.html",
        "sidebar/search.html",
        "sidebar/scroll-start.html",
        "sidebar/navigation.html",
        "sidebar/scroll-end.html",
    ]
}

INTERNAL = {"executive.commands.declaration", "executive.commands.formatting"}
API = "docs/python-api", ("Python API reference", "docs/site/api")
"""Only the site has the reference; it follows this page in the navigation."""


def navigation(readme: str) -> dict[str, list[tuple[str, str]]]:
    """Return caption, titles and pages of each group: the rows of the README's table of pages."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for caption, cell in re.findall(r"^\| \*\*(.+?)\*\* \| (.+) \|$", readme, re.MULTILINE):
        pages = groups[caption] = []
        for title, page in re.findall(r"\[([^\]]+)\]\(([^)#\s]+)\.md\)", cell):
            pages.append((title[0].upper() + title[1:], page))
            pages += [API[1]] if page == API[0] else []
    return groups


def _add_parts(_app: Any, page: str, source: list[str]) -> None:
    """Add to a page what only the site has."""
    if page == root_doc:
        for caption, pages in navigation(source[0]).items():
            entries = "\n".join(f"{title} <{target}>" for title, target in pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{entries}\n```\n"
    elif page.endswith("/README"):  # of a package: linked from pages, not a page for users
        source[0] = f"---\norphan: true\nnosearch: true\n---\n\n{source[0]}"


def _skip(_app: Any, what: str, _name: str, member: Any, skip: bool, _options: Any) -> bool:
    """Omit from the Python API names of other projects, and internal ones."""
    home = getattr(member, "__module__", "")
    foreign = home.split(".")[0] not in PACKAGES or home in INTERNAL
    return skip or (what == "module" and foreign)


def setup(app: Any) -> None:
    """Connect the functions above."""
    app.connect("source-read", _add_parts)
    app.connect("autodoc-skip-member", _skip)
