"""The site: `pip install '.[docs]' && sphinx-build -W docs docs/_build/html`."""

from __future__ import annotations

import inspect
import os
import sys
import warnings
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]  # problems/ stands beside the package
of_workers = [str(HERE.parent), os.environ.get("PYTHONPATH", "")]
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, of_workers))
os.environ.setdefault("OMP_NUM_THREADS", "1")

import api_pages  # noqa: E402
import command_line  # noqa: E402
import parts_pages  # noqa: E402

import casahunt  # noqa: E402

for name in casahunt.__all__:  # a class that is called otherwise where it is at home is described, not "an alias of"
    thing = getattr(casahunt, name)
    if isinstance(thing, type) and thing.__name__ != name:
        thing.__name__ = thing.__qualname__ = name

project = "casahunt"
author = "casahunt developers"
copyright = "casahunt developers"
version = release = casahunt.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "mathml",
    "sphinx_gallery.gen_gallery",
    "numpydoc",
]
exclude_patterns = ["_build", "_templates", "examples", "**/sg_execution_times.rst", "sg_execution_times.rst"]
nitpicky = False
suppress_warnings = ["config.cache"]  # the order of the gallery is a function, which no cache can hold

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autosummary_generate = [f"reference/api/{topic.file}.rst" for topic in api_pages.TOPICS]
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

templates_path = ["_templates"]
html_theme = "furo"
html_math_renderer = "mathml"
html_title = "casahunt"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False

warnings.filterwarnings("ignore", message="FigureCanvasAgg is non-interactive")


class InReadingOrder:
    """Examples in the order of examples/order.txt, which names every one."""

    def __init__(self, folder: str) -> None:
        self.names = (HERE / "examples" / "order.txt").read_text(encoding="utf-8").split()

    def __call__(self, name: str) -> int:
        return self.names.index(name)

    def __repr__(self) -> str:
        return "<in reading order>"


sphinx_gallery_conf = {
    "examples_dirs": ["examples"],
    "gallery_dirs": ["auto_examples"],
    "filename_pattern": r"/\w+\.py$",
    "within_subsection_order": InReadingOrder,
    "abort_on_example_error": True,
    "download_all_examples": False,
    "capture_repr": (),
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "matplotlib_animations": False,
    "reset_modules": ("matplotlib",),
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "copyfile_regex": r"",
    "parallel": 2,
}


def inherited(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """A class that adds to another one has the attributes of that, too."""
    if what == "class" and "Attributes" not in lines:
        docs = [inspect.cleandoc(base.__doc__ or "").partition("Attributes\n---") for base in obj.__mro__[1:]]
        theirs = next((title + rest.partition("\n\nExamples\n")[0] for _, title, rest in docs if title), "")
        before = lines.index("Examples") if "Examples" in lines else len(lines)
        lines[before:before] = ["", *theirs.splitlines(), ""]


def plain(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are read in a terminal: there |x| is a magnitude and x* a fixed point, and no markup."""
    lines[:] = [line.replace("|", r"\|").replace("**kw", r"\*\*kw") for line in lines]


def setup(app: Any) -> None:
    """Write the pages that are read off the program before anything is parsed."""
    app.connect("autodoc-process-docstring", inherited, priority=100)  # before numpydoc reads sections
    app.connect("autodoc-process-docstring", plain)
    command_line.write(HERE / "reference" / "commands")
    api_pages.write(HERE / "reference" / "api")
    parts_pages.write(HERE / "reference" / "parts")
