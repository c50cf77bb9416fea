"""Configuration of the documentation: `sphinx-build -W --keep-going docs docs/_build` builds it."""

import sys
from pathlib import Path

import hingepair

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "hingepair"
version = release = hingepair.__version__
copyright = "the authors of hingepair"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "command_help",
    "mathml",
]
exclude_patterns = ["_build", "gallery", "README.md"]
default_role = "code"  # docstrings put names between single backticks

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

autodoc_default_options = {"members": True, "inherited-members": "Shown, Frozen, Exception"}
templates_path = ["_templates"]  # of the pages in _generated, one for each name of reference.md
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings give shapes and units, which types do not
napoleon_numpy_docstring = False
napoleon_attr_annotations = False
napoleon_use_ivar = True
napoleon_use_rtype = False  # or the words before a colon come last

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_examples",
    "filename_pattern": r"plot_",
    "image_scrapers": ("shown_figures.scrape",),
    "download_all_examples": False,
    "show_memory": False,
    "min_reported_time": 1e9,  # run times depend on the machine that builds the pages
    "show_signature": False,
    "remove_config_comments": True,
    "write_computation_times": False,
}
suppress_warnings = ["config.cache"]  # the settings of the gallery are not written to the cache of the build

html_theme = "furo"
html_title = f"hingepair {version}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
