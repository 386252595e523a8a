"""Sphinx's configuration of the documentation; ``docs/build.py`` prepares the pages and runs it."""

project = "receding_fenicsx"
author = "The receding_fenicsx developers"
copyright = author
extensions = ["myst_parser", "sphinx.ext.mathjax", "sphinx-mathjax-offline"]
myst_enable_extensions = ["dollarmath"]
myst_dmath_double_inline = True
myst_heading_anchors = 3
html_theme = "furo"
html_title = "receding_fenicsx"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
highlight_language = "none"
smartquotes = False
add_module_names = False
python_use_unqualified_type_names = True
toc_object_entries = (
    False  # contents of a page are its modules: with all functions the site takes twice as long
)
# names of types in signatures are links where they are unique
suppress_warnings = ["ref.python"]
