"""The site: Markdown pages, the examples as a gallery, and the reference from the docstrings.

    python -m sphinx -j auto -W --keep-going docs docs/_build

Nothing is fetched while it is built.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from names import records

import adaptsize

project = "adaptsize"
author = "The adaptsize developers"
copyright = author
version = release = adaptsize.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "formulas",
    "names",
    "navigation",
    "pages",
    "scenes",
    "unbroken",
]
exclude_patterns = ["_build"]
templates_path = ["_templates"]
nitpicky = True

myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3

autosummary_generate = True
autosummary_context = {"records": records()}
autodoc_typehints = "none"  # the docstrings state the types, with shapes and units
autodoc_member_order = "bysource"
numpydoc_show_class_members = False  # autodoc shows them
numpydoc_xref_param_type = False

copybutton_selector = "div:not(.highlight-text) > div.highlight > pre"  # code, not its output

html_theme = "furo"
html_logo = html_favicon = "_static/logo.svg"  # by _ext/make_logo.py
html_title = f"adaptsize {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_copy_source = False
html_math_renderer = "mathml"
html_theme_options = {"navigation_with_keys": True}
