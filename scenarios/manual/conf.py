"""Settings of Sphinx for the manual. Its sources are a copy of the project: the READMEs are pages as they
are."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from numpy.typing import ArrayLike  # noqa: E402
from sphinx.util.typing import stringify_annotation  # noqa: E402

import bullet_tendon  # noqa: E402

project = "bullet_tendon"
author = "the bullet_tendon developers"
copyright = author
version = release = bullet_tendon.__version__

MANUAL = "scenarios/manual"
GENERATED = f"{MANUAL}/generated"
root_doc = f"{MANUAL}/index"
READMES = (
    "bullet_tendon/",
    "bullet_tendon/core/",
    "scenarios/",
    "scenarios/*/",
    "urdf/",
    "tests/",
)
include_patterns = [
    "*.md",
    *(f"{folder}README.md" for folder in READMES),
    f"{MANUAL}/*.md",
    f"{GENERATED}/**",
]
suppress_warnings = ["toc.not_included"]  # a README that another one refers to is enough
exclude_patterns = ["**/*.ipynb", "**/sg_execution_times.rst"]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "gallery",
    "completeness",
]

myst_heading_anchors = 3
myst_enable_extensions = ["attrs_inline"]
myst_url_schemes = ("http", "https")

autosummary_generate = True
templates_path = [str(Path(__file__).parent / "templates")]  # autosummary looks beside the sources otherwise
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True

# Made by methods, not by their constructors.
HANDLES = (
    "Tendon",
    "Grip",
    "Attachment",
    "Line",
    "Tunnel",
    "Ligament",
    "Wrap",
    "Tensioner",
    "Fixation",
    "Cartilage",
    "Skin",
)

sphinx_gallery_conf = {
    "examples_dirs": f"{MANUAL}/recipes",
    "gallery_dirs": f"{GENERATED}/recipes",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "gallery.RecipeOrder",
    "write_computation_times": False,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "image_scrapers": ("gallery.take_pictures",),
    "reset_modules": ("gallery.close_clients",),
    "abort_on_example_error": True,
}

html_theme = "pydata_sphinx_theme"
html_title = f"bullet_tendon {release}"
html_show_sourcelink = False
scenario_pages = f"{GENERATED}/scenarios"
html_extra_path = ["generated/scenarios/replays"]  # made when the scenarios are run
Path(__file__).with_name("generated").joinpath("scenarios", "replays").mkdir(parents=True, exist_ok=True)

html_static_path = ["static"]
html_sidebars = {
    page: []
    for page in (
        f"{MANUAL}/installing",
        f"{MANUAL}/first_tendon",
        "bullet_tendon/core/README",
        "scenarios/benchmarks/README",
    )
}
html_css_files = ["manual.css"]
html_additional_pages = {"index": "entry.html"}
html_theme_options = {
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": [],
    "footer_end": [],
}


def setup(app) -> None:
    app.connect("autodoc-process-signature", shortened_signature)


def shortened_signature(app, what, name, obj, options, signature, returns):
    """Hide the constructors of handles, and write ArrayLike as it is written in the source."""
    if what == "class" and name.rpartition(".")[2] in HANDLES:
        return "", returns
    for long in (
        stringify_annotation(ArrayLike, mode) for mode in ("smart", "fully-qualified-except-typing")
    ):
        signature = signature and signature.replace(long, "ArrayLike")
    return signature, returns
