"""Sphinx's settings for the site; `make site` hands it the pages that pages.py has written.

Nothing in a page comes from elsewhere: formulas become MathML, which browsers draw themselves;
fonts and scripts are those of the theme.
"""

import re
import shutil
from importlib.metadata import version as installed
from pathlib import Path

from docutils.nodes import SkipNode
from docutils.utils.math import latex2mathml

from analysis import ROOT
from workbench import explorer

project = "Inertial compendium"
version = release = installed("inertial-compendium")
copyright = f"the contributors, MIT licence; version {version}"  # the name that Sphinx asks for
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

nb_execution_mode = "off"
nb_render_markdown_format = "myst"
nb_code_prompt_show = "Show the code"
nb_code_prompt_hide = "Hide the code"
myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3
myst_dmath_allow_space = myst_dmath_allow_digits = False  # "$4000 or $6000" is no formula

autodoc_member_order = "bysource"
toc_object_entries_show_parents = "hide"
autodoc_typehints = "none"  # types stand in the docstrings, with shape and unit
napoleon_use_rtype = False
napoleon_use_ivar = True
suppress_warnings = ["ref.python"]  # two classes may have an attribute of one name

html_theme = "pydata_sphinx_theme"
html_title = project
html_static_path = [str(Path(__file__).parent / "static")]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
html_domain_indices = False
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button-field"],
    "article_header_start": [],
    "show_toc_level": 1,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "back_to_top_button": False,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
ALONE = (
    "index",
    "claims",
    "gallery",
    "explore",
    "errata",
    "coverage",
    "symbols",
    "search",
    "genindex",
    "your-logs",
    "conventions",
    "contributing",
)
html_sidebars = {page: [] for page in ALONE}  # pages that take the width of the list beside them
html_context = {"default_mode": "auto"}


def _mathml(self, node):
    """Write a formula as MathML."""
    block = node.tagname == "math_block"
    tex = node.astext().replace("−", "-")
    tex = re.sub(r"[^\x00-\x7f\w]", r"\\text{\g<0>}", tex)  # °, →, ∞: docutils knows commands only
    formula = latex2mathml.tex2mathml(tex, as_block=block)
    self.body.append(f'<div class="math">{formula}</div>' if block else formula)
    raise SkipNode


def _with_files(app, failure):
    """Lay beside the pages what they lead to: the explorer, pictures, numbers, registers."""
    if failure:
        return
    explorer.write(Path(app.outdir), home="index.html")
    for source, target in (
        (ROOT / "figures", "figures"),
        (Path(app.srcdir) / "sharp", "sharp"),
        (ROOT / "data/published", "published"),
        (ROOT / "notebooks", "notebooks"),
    ):
        shutil.copytree(
            source,
            Path(app.outdir) / target,
            dirs_exist_ok=True,
            ignore=shutil.ignore_patterns("*.lock", "*.md"),
        )


def setup(app):
    """Hand Sphinx the two functions above."""
    app.add_html_math_renderer("mathml", (_mathml, None), (_mathml, None))
    app.connect("build-finished", _with_files)
