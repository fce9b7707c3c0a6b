"""How Sphinx builds these pages: ``sphinx-build -W docs site/html``."""

import importlib.metadata
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "flexid"
author = "The flexid developers"
copyright = author  # noqa: A001 - Sphinx's name
release = importlib.metadata.version("flexid")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_copybutton",
    "mathml",
]
exclude_patterns = ["**/*.py"]
nitpicky = False

# Markdown: equations in dollars, and a name for every heading that a link may go to.
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

# Nothing is fetched when a page is read.
html_math_renderer = "mathml"
html_theme = "furo"
html_title = "flexid"
html_static_path = ["assets/style.css"]
html_css_files = ["style.css"]
html_copy_source = False
html_show_sphinx = False

# The copy button leaves out prompts and output.
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# The interface, in the order in which it is written.
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False
# A name between single backticks is a link, if there is anything of that name.
default_role = "py:obj"
