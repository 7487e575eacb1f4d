"""Settings of Sphinx: ``python -m sphinx -W docs out/docs`` builds the documentation."""

import sys
import tomllib
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.highlighting import lexers

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

project = "armdesign"
release = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
author = "the authors of armdesign"
project_copyright = "MIT licence"

extensions = [
    "myst_nb",  # pages are Markdown or notebooks, which GitHub shows as well
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated_pages",  # the reference of the machine file and the table of the validation
]
lexers["csv"] = TextLexer()  # as it stands
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
nb_execution_mode = "off"  # notebooks are kept executed; a test runs them again
myst_enable_extensions = ["attrs_inline", "colon_fence"]
myst_heading_anchors = 3  # links to headings, as GitHub makes them
html_theme = "furo"
html_title = f"armdesign {release}"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_show_sourcelink = False
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
