"""Configuration of the documentation site: ``make docs`` builds it into build/docs."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "Agg")
sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
sys.path.insert(0, str(Path(__file__).parent))

import live_pages

import dalembert

project = "dalembert"
author = "the dalembert developers"
version = release = dalembert.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.mermaid",
]
exclude_patterns = ["gallery"]
html_theme = "pydata_sphinx_theme"
html_title = "dalembert"
WIDE = ("index", "generated/gallery/index")
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "header_links_before_dropdown": 7,
    "navbar_align": "left",
    "secondary_sidebar_items": {"**": ["page-toc", "sourcelink"], **{page: [] for page in WIDE}},
}
html_sidebars = {page: [] for page in WIDE}
html_static_path = ["_static"]
html_css_files = ["site.css"]

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings give types and shapes
napoleon_google_docstring = False
napoleon_use_ivar = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "image_scrapers": ("matplotlib", "gallery_frames.save_frame"),
    "thumbnail_size": (400, 280),
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"conf\.py$",
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_signature": False,
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "reset_modules": ("gallery_frames.use_style",),
    "capture_repr": ("_repr_html_",),  # animations, and not the values of calls such as `panel.set`
    "write_computation_times": False,
}


def setup(app):
    """Write the pages that simulate into the site, where scripts run and there is a compiler for them."""
    app.connect("build-finished", write_live_pages)


def write_live_pages(app, exception):
    """Write the pages after the site is built."""
    runs = str(app.config.plot_gallery) not in ("0", "False")
    if exception is None and runs and app.builder.name == "html" and find_spec("ziglang") is not None:
        live_pages.write(Path(app.outdir) / "live")
