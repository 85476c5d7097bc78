"""The documentation as a site: `make docs`. Tutorials are executed when it is built, without a network."""

from importlib.metadata import version as installed

project = "taxelflow"
author = "The taxelflow authors"
version = release = installed("taxelflow")
language = "en"

extensions = ["myst_nb", "sphinx.ext.autodoc"]
exclude_patterns = ["_build", "jupyter_execute", "results"]
html_theme = "furo"
html_title = f"taxelflow {release}"
html_show_copyright = False

myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s; the first run on a machine compiles kernels
nb_merge_streams = True
nb_output_stderr = "remove"  # the note that kernels are compiled depends on the machine

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
default_role = "code"
