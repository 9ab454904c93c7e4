"""The lowest versions that pyproject.toml allows, one a line, as pip takes constraints: of the extras of users too.

    python .ci/floors.py > floors.txt && pip install -c floors.txt ".[explore,pandas]"
"""

from __future__ import annotations

import tomllib
from pathlib import Path

DEVELOPERS = ("test", "bench", "mutation", "docs")
"""Extras whose tools are nobody's but theirs."""

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = {name: of for name, of in project["optional-dependencies"].items() if name not in DEVELOPERS}
for requirement in dict.fromkeys([*project["dependencies"], *sum(extras.values(), [])]):
    if ">=" in requirement:
        print(requirement.replace(">=", "=="))
