"""How Sphinx builds the site; `make docs` calls it, offline."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).with_name("_extensions")))

from ruptfx import __version__

project = "ruptfx"
author = "The ruptfx developers"
copyright = "The ruptfx developers"
version = release = __version__

extensions = [
    "mathml",
    "myst_parser",
    "numpydoc",
    "pictures",
    "ruptfx_reference",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_build"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "substitution"]
myst_substitutions = {"release": __version__}
html_math_renderer = "mathml"
smartquotes = False  # options (--trust) and values ("30 MPa") stay as they are typed
myst_heading_anchors = 3
myst_links_external_new_tab = True

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True  # as in the source: a lambda would be shown with its address
numpydoc_show_class_members = False
copybutton_prompt_text = "$ "

html_theme = "pydata_sphinx_theme"
html_title = "ruptfx"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_search_summary = False  # it would fetch pages, which browsers refuse where they are files
html_sidebars = {"peers": []}  # a section of one page
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 5,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
