"""Run time against error: casahunt, AUTO-07p, solve_bvp, shooting and heyoka on the same problems in one run.

    python scripts/benchmark.py [--out DIR] [--quick] [--only orbit-stable ... van-der-pol belt relay gallery]

Scenes, for the servo of Table 1 and both friction models:

    orbit-stable     K = 0.1, from nothing: the starting guess is part of the time
    orbit-unstable   K = 0.4, from nothing: casahunt goes round the fold; the peers start at the solution of 0.41
                     (shooting on the stable branch starts from a simulation, solve_bvp from the solution of 0.1025)
    fold             the largest gain, from nothing; AUTO's is that of its diagram
    diagram          from the stable orbit at K = 0.0321, given to casahunt and AUTO alike, round the fold to 0.0321;
                     casahunt's tolerance is that of the points, the fold is located to 1e-10 (Switch) or 1e-9
                     (LuGre); errors are the fold's
    ensemble         folds of many servos at once, against their number; a Newton step against intervals and degree
    gains            stable cycles from nothing at gains up to next to the fold, casahunt and heyoka

heyoka's Taylor series are given what their user has reduced by hand (peers/servo_heyoka.py): half a cycle with the
stick in closed form (Switch), from x1 = 0 to the next x1 = 0 (LuGre); the unstable Switch cycle from a neighbour, the
Switch fold from 0.3 % off.

Scenes of the gallery (race/gallery.py), with shooting by heyoka's Taylor series besides:

    van-der-pol belt relay   error against time, from a start off the cycle and from the cycle of a neighbour
    gallery                  a table of all problems, from starts off the cycle: what a true error of 1e-9 costs

Errors of the servo's are relative, against the reference values of problems/table1.py (independent programs, 15
digits), never against casahunt.  Every time is the least processor time of some repeats in this process (with
OMP_NUM_THREADS=1 that of one thread), without imports; AUTO's is that of its own process.  "First time" is with what
CasADi or heyoka compile for a problem that the process has not seen.  A peer that is missing, or that fails, is a row
with the reason.  Needs scipy (extra "bench"); AUTO-07p needs Debian's packages auto-07p and gfortran.
Writes benchmark.csv, benchmark.json, benchmark.png and the table to standard output; of the gallery gallery.csv and
gallery.png, of the ensembles ensemble.png.
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

from casahunt.servo.friction import MODELS  # noqa: E402
from scripts.race import precision  # noqa: E402
from scripts.race.gallery import rows_of  # noqa: E402
from scripts.race.others import diagram_rows, peer_orbits, peers_down_the_branch  # noqa: E402
from scripts.race.ours import casahunt_orbits, fold_rows, memories, stick_rows, where_the_time_goes  # noqa: E402
from scripts.race.rows import ALONE, GALLERY, SCENES, Row  # noqa: E402
from scripts.race.scaling import SCENE as ENSEMBLE  # noqa: E402
from scripts.race.scaling import drawn, scaling_rows, slopes  # noqa: E402
from scripts.race.table import picture, ratios, table  # noqa: E402
from scripts.race.taylor import along_rows, taylor_rows  # noqa: E402

ALL = (*SCENES, ENSEMBLE, *GALLERY)


def main() -> None:
    """Measure, write, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="benchmark", metavar="DIR", help="folder to write into (default benchmark)")
    parser.add_argument("--only", nargs="+", choices=ALL, default=list(ALL), help="scenes")
    parser.add_argument("--model", nargs="+", choices=MODELS, default=list(MODELS), help="friction models")
    parser.add_argument("--quick", action="store_true", help="fewer repeats, AUTO-07p's LuGre run at one mesh only")
    options = parser.parse_args()
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    repeats = 2 if options.quick else 5
    rows: list[Row] = []
    of_the_servo = [scene for scene in options.only if scene in SCENES]
    for scene in options.only:
        for model in options.model if scene in SCENES else ("",):
            if scene == ENSEMBLE:
                fresh = scaling_rows()
            else:
                fresh = servo_rows(scene, model, repeats, options.quick) if model else list(rows_of(scene, repeats))
            print(table(fresh), flush=True)
            rows += fresh
    alone = [scene for scene in of_the_servo if scene in ALONE]
    facts: dict[str, Any] = {
        "python": platform.python_version(), "casadi": casadi.__version__, "numpy": np.__version__,
        "processor": platform.machine(), "peak_memory_MB": memories(alone, options.model),
        "ratios": ratios(rows),
    }  # fmt: skip
    facts["where_the_time_goes"] = {m: where_the_time_goes(m) for m in options.model if "diagram" in options.only}
    for line in facts["ratios"]:
        print(line)
    for model, shares in facts["where_the_time_goes"].items():
        print(f"where the time of the {model} diagram goes: "
              + ", ".join(f"{what} {share:.0%}" for what, share in shares.items()))  # fmt: skip
    peaks = ", ".join(f"{scene} {peak:.0f}" for scene, peak in facts["peak_memory_MB"].items())
    if peaks:
        print(f"peak memory [MB], import included: {peaks}")
    (out / "benchmark.json").write_text(json.dumps(facts | {"rows": [asdict(r) for r in rows]}, indent=1) + "\n")
    with (out / "benchmark.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])))
        writer.writeheader()
        writer.writerows(asdict(r) for r in rows)
    if of_the_servo:
        picture(rows, out / "benchmark.png")
    for (model, method, against), slope in slopes(rows).items():
        print(f"{model}, {method}: processor time goes like {against}^{slope:.2f}")
    drawn(rows, out / "ensemble.png")
    gallery_files(rows, out)


def servo_rows(scene: str, model: str, repeats: int, quick: bool) -> list[Row]:
    """The rows of a scene of the servo."""
    if scene == "gains":
        return along_rows(model, repeats)
    if scene.startswith("orbit"):
        fresh = casahunt_orbits(scene, model, repeats)
        fresh += stick_rows(scene) if model == "switch" and scene == "orbit-stable" else []
        fresh += peer_orbits(scene, model) + taylor_rows(scene, model, repeats)
        return fresh + (peers_down_the_branch(model) if scene == "orbit-unstable" else [])
    if scene == "fold":
        return fold_rows(model, repeats) + taylor_rows(scene, model, repeats)
    return diagram_rows(model, repeats, quick)


def gallery_files(rows: list[Row], out: Path) -> None:
    """Table and picture of the gallery, where its scenes were measured."""
    lines = precision.in_table(rows)
    if lines:
        print(precision.as_markdown(lines))
        precision.write_table(lines, out / "gallery.csv")
    precision.panels(rows, out / "gallery.png")


if __name__ == "__main__":
    main()
