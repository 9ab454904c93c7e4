"""Run time against error: casahunt, AUTO-07p, solve_bvp and single shooting on the same problems in one run.

    python scripts/benchmark.py [--out DIR] [--quick] [--only orbit-stable orbit-unstable fold diagram]

Scenes, for the servo of Table 1 and both friction models:

    orbit-stable     K = 0.1, from nothing: the starting guess is part of the time
    orbit-unstable   K = 0.4, from nothing: casahunt goes round the fold; the peers start at the solution of 0.41
                     (shooting on the stable branch starts from a simulation, solve_bvp from the solution of 0.1025)
    fold             the largest gain, from nothing; AUTO's is that of its diagram
    diagram          from the stable orbit at K = 0.0321, given to casahunt and AUTO alike, round the fold to 0.0321;
                     casahunt's tolerance is that of the points, the fold is located to 1e-10 (Switch) or 1e-9
                     (LuGre); errors are the fold's

Errors are relative, against the reference values of problems/table1.py (two independent programs), never
against casahunt; they saturate at the digits of that table, about 1e-10.  Every time is the best of some repeats in
this process, without imports; AUTO's is that of its own process.  A peer that is missing, or that fails, is a row
with the reason.  Needs scipy (extra "bench"); AUTO-07p needs Debian's packages auto-07p and gfortran.
Writes benchmark.csv, benchmark.json, benchmark.png and the table to standard output.
"""

from __future__ import annotations

import argparse
import csv
import json
import platform
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import casadi
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt.servo.hunting import MODELS  # noqa: E402
from scripts.race.others import diagram_rows, peer_orbits, peers_down_the_branch  # noqa: E402
from scripts.race.ours import casahunt_orbits, fold_rows, memories, stick_rows, where_the_time_goes  # noqa: E402
from scripts.race.rows import SCENES, Row  # noqa: E402
from scripts.race.table import picture, ratios, table  # noqa: E402


def main() -> None:
    """Measure, write, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="benchmark", metavar="DIR", help="folder to write into (default benchmark)")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES), help="scenes to measure")
    parser.add_argument("--model", nargs="+", choices=MODELS, default=list(MODELS), help="friction models")
    parser.add_argument("--quick", action="store_true", help="fewer repeats, AUTO-07p's LuGre run at one mesh only")
    options = parser.parse_args()
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    repeats = 2 if options.quick else 5
    rows: list[Row] = []
    for scene in options.only:
        for model in options.model:
            fresh: list[Row] = []
            if scene.startswith("orbit"):
                fresh += casahunt_orbits(scene, model, repeats)
                fresh += stick_rows(scene) if model == "switch" and scene == "orbit-stable" else []
                fresh += peer_orbits(scene, model)
                fresh += peers_down_the_branch(model) if scene == "orbit-unstable" else []
            elif scene == "fold":
                fresh += fold_rows(model, repeats)
            else:
                fresh += diagram_rows(model, repeats, options.quick)
            print(table(fresh), flush=True)
            rows += fresh
    facts: dict[str, Any] = {
        "python": platform.python_version(), "casadi": casadi.__version__, "numpy": np.__version__,
        "processor": platform.machine(), "peak_memory_MB": memories(options.only, options.model),
        "ratios": ratios(rows),
    }  # fmt: skip
    facts["where_the_time_goes"] = {m: where_the_time_goes(m) for m in options.model if "diagram" in options.only}
    for line in facts["ratios"]:
        print(line)
    for model, shares in facts["where_the_time_goes"].items():
        print(f"where the time of the {model} diagram goes: "
              + ", ".join(f"{what} {share:.0%}" for what, share in shares.items()))  # fmt: skip
    print("peak memory [MB], import included: "
          + ", ".join(f"{scene} {peak:.0f}" for scene, peak in facts["peak_memory_MB"].items()))  # fmt: skip
    (out / "benchmark.json").write_text(json.dumps(facts | {"rows": [asdict(r) for r in rows]}, indent=1) + "\n")
    with (out / "benchmark.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])))
        writer.writeheader()
        writer.writerows(asdict(r) for r in rows)
    picture(rows, out / "benchmark.png")


if __name__ == "__main__":
    main()
