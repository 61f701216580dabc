"""The site of the documentation: `./scripts/docs.sh` builds it from the pages of docs/."""

import pkgutil
import re
from importlib import import_module
from typing import Any

from sphinx.application import Sphinx

import vsr2._native

# Autodoc changes annotations of pydantic's base class as it goes; a model that allows further keys
# cannot be made after that.
for _room in pkgutil.iter_modules(vsr2.__path__):
    if _room.ispkg and _room.name != "cli":
        import_module(f"vsr2.{_room.name}")

project = "VSR2"
author = "The VSR2 developers"
release = version = vsr2._native.build_facts()["version"]
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
]
root_doc = "index"
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".ipynb": "myst-nb"}
# The start page includes README.md.
exclude_patterns = ["README.md", "_site"]
default_role = "code"

myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
# A cell takes some seconds; a machine that has other work is no error.
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "imported-members": True}
napoleon_numpy_docstring = False
napoleon_use_ivar = True
# Several classes have attributes of one name, to which a docstring's list of attributes refers.
suppress_warnings = ["ref.python"]

html_theme = "furo"
html_title = f"VSR2 {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False


def _outside(app: Sphinx, document: str, source: list[str]) -> None:
    """Links to the index and to pages of the root, as this site has them."""
    text = re.sub(r"\]\(((?:\.\./)+(?:CHANGELOG|CONTRIBUTING)\.md)\)", r"](path:\1)", source[0])
    up = "../" * document.count("/")
    source[0] = text.replace(f"]({up}README.md)", f"]({up}index.rst)")


def setup(app: Sphinx) -> dict[str, Any]:
    """Mend links before a page is read."""
    app.connect("source-read", _outside)
    return {"parallel_read_safe": True}
