"""Answers in files: a line each as they come, and all of them in one.

    FOLDER/*.jsonl         {"question": ..., "kind": ..., "words": ..., "numbers": ..., "truth": ..., "seconds": ...}
    FOLDER/answers.json    {"tree": ..., "answers": {question: the rest, ...}}

`tree` is a digest of the package: a folder holds the answers of one tree.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import casahunt

MERGED = "answers.json"
Answers = dict[str, dict[str, Any]]
"""{question: answer}"""


def tree() -> str:
    """A digest of the sources of the package."""
    digest, root = sha256(), Path(casahunt.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(f"{path.relative_to(root).as_posix()}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def lines(folder: Path) -> Iterator[dict[str, Any]]:
    """The rows of all files of a folder; what was cut in the middle is left out."""
    for path in sorted(folder.glob("*.jsonl")):
        for line in path.read_text(encoding="ascii").splitlines():
            try:
                row: dict[str, Any] = json.loads(line)
            except json.JSONDecodeError:
                continue
            yield row


def merged(folder: Path) -> Answers:
    """The answers of a folder, in the order of their names; written to one file, too."""
    answers = {row["question"]: row for row in sorted(lines(folder), key=lambda row: str(row["question"]))}
    rows = ",\n".join(f"{json.dumps(name)}: {json.dumps(row)}" for name, row in answers.items())
    text = f'{{"tree": {json.dumps(tree())}, "answers": {{\n{rows}\n}}}}\n'
    (folder / MERGED).write_text(text, encoding="ascii")
    return answers


def read(path: Path) -> Answers:
    """The answers of a file, or of a folder."""
    found: Answers = json.loads((path / MERGED if path.is_dir() else path).read_text(encoding="ascii"))["answers"]
    return found
