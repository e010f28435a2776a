"""How the documentation is built: ``make docs``."""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# The gallery uses the studies, which lie beside the package in a clone.
sys.path.insert(0, str(ROOT))
# Threads that wait actively take forever where cores are shared; the pictures here are small.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import polaropt  # noqa: E402

project = "polaropt"
author = "polaropt developers"
project_copyright = "2026, polaropt developers"
version = release = polaropt.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "matplotlib.sphinxext.plot_directive",
    "myst_parser",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.bibtex",
]
exclude_patterns = ["_build", "_templates", "gallery", "how/figures", "auto_gallery/GALLERY_HEADER.rst"]
templates_path = ["_templates"]
# `name` in a docstring is a thing of Python, linked where it has a page here.
default_role = "py:obj"
# Options such as --align keep their two hyphens.
smartquotes = False
suppress_warnings = [
    # The page of results is put together from tables, whose headings skip levels.
    "myst.header",
]

# The sentence of each warning, as {{ NAME }}: it stands in one place.
myst_substitutions = {member.name: member.value for member in polaropt.SeparationWarning}
myst_enable_extensions = ["attrs_block", "colon_fence", "deflist", "substitution"]
myst_heading_anchors = 4

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "unsrt"
bibtex_reference_style = "author_year"

plot_html_show_formats = False
plot_html_show_source_link = True
plot_formats = [("png", 110)]
plot_rcparams = {"figure.constrained_layout.use": True, "font.size": 11}
plot_apply_rcparams = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "copyfile_regex": "",
    "remove_config_comments": True,
    # A notebook is opened far from these pages.
    "first_notebook_cell": "# This needs polaropt with matplotlib: in its folder, pip install '.[plot]'",
    "show_memory": False,
    "min_reported_time": 0,
    # They would lie among the sources, and no reader asks.
    "write_computation_times": False,
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": True,
    "image_scrapers": ("matplotlib",),
    # Links from names to their pages; those of other packages would need the network.
    "doc_module": ("polaropt",),
    "reference_url": {"polaropt": None},
    "backreferences_dir": "auto_gallery/uses",
}

html_theme = "pydata_sphinx_theme"
html_title = "polaropt"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "footer_start": ["copyright"],
    "footer_end": ["sphinx-version"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_context = {"default_mode": "auto"}
# Pages without others below them.
html_sidebars = {name: [] for name in ("warnings", "results", "bibliography", "contributing", "changes")}

# `make linkcheck` asks the network; building does not.
linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_anchors = False
