"""How Sphinx builds these pages: `make docs`, then open build/docs/index.html. Nothing in them needs the network."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

from pix2face import __version__  # noqa: E402  (found through the path above)

project = "pix2face"
author = "The pix2face authors"
release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "command_help"]

# Two dashes are the start of an option, not a dash.
smartquotes = False

html_theme = "furo"
html_title = f"pix2face {release}"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False

# Headings can be linked to by their words, as on code hosting sites.
myst_heading_anchors = 4
# Indented blocks are commands far more often than Python.
highlight_language = "console"

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True}
# Single backticks in docstrings are code, as double ones are.
default_role = "code"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
# Other packages' types have no pages here.
nitpick_ignore_regex = [("py:.*", r".*")]


def escape_bars(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Docstrings write absolute values as |x|, which reStructuredText would look up as a name."""
    lines[:] = [re.sub(r"(`+[^`]*`+)|\|", lambda match: match[1] or r"\|", line) for line in lines]


def setup(app: Sphinx) -> None:
    """Connects what this project needs to Sphinx."""
    app.connect("autodoc-process-docstring", escape_bars)
