"""The lowest versions that pyproject.toml allows, one a line, as pip takes constraints.

    python .ci/floors.py > floors.txt && pip install -c floors.txt .
"""

from __future__ import annotations

import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
for requirement in project["dependencies"]:
    print(requirement.replace(">=", "=="))
