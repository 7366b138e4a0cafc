"""Sphinx configuration. Built with -W: a broken reference or a failing example fails the build."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as distribution_version
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "agg")
sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import matplotlib

matplotlib.use("agg")

# VTK ends the interpreter where OpenGL is missing; the probe finds out in a subprocess and chooses the window class.
from scenegraph.render.probe import require_gl

require_gl()

project = "scenegraph-culling"
copyright = "2026, the scenegraph-culling developers"
release = distribution_version("scenegraph-culling")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "stage_pages",
]
exclude_patterns = ["_build", "gallery/*.ipynb", "gallery/*.py", "gallery/*.md5"]
# `Frame` in a docstring is code, and a link where there is something to link to.
default_role = "py:obj"

myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
suppress_warnings = [
    # Configuration values that are functions or classes; they do not change between builds.
    "config.cache",
    # Included files link to each other by their place in the repository.
    "myst.xref_missing",
]

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autoclass_content = "class"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    # Every example runs.
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "remove_config_comments": True,
}

html_theme = "furo"
html_title = "scenegraph-culling"
html_copy_source = False
html_show_sphinx = False
