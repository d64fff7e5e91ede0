"""Settings of Sphinx; docs/run_pages.py calls it."""

import sfmcpp

project = "sfmcpp"
author = "sfmcpp authors"
copyright = "2026, sfmcpp authors"
version = release = sfmcpp.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
]
myst_enable_extensions = ["dollarmath", "colon_fence", "attrs_block"]
myst_heading_anchors = 3
exclude_patterns = ["**/model/**"]

html_theme = "furo"
html_title = f"sfmcpp {release}"
html_show_sphinx = False
html_static_path = ["static"]
html_css_files = ["site.css"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
suppress_warnings = ["misc.highlighting_failure"]
