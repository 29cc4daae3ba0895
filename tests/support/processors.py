"""Small runs of what is to have the same bytes on every processor, in one process.

``python tests/support/processors.py FOLDER [MECHANISM ..]`` writes what every command prints as
JSON and CSV, and the files of its runs, below FOLDER. :mod:`test_processors` runs it as other
processors would and compares.
"""

import contextlib
import csv
import io
import json
import sys
from pathlib import Path

#: Free parameters of a small search.
RANGES = {
    "2pauu-ppap": "m = [0.5, 1.5]\nn = 0.7\nl1 = [0.5, 1.5]\nl2 = [0.5, 1.5]\nc = 0.1\n",
    "3-cur": "Ra = [0.1, 0.4]\nRb = [0.05, 0.25]\nL = [0.15, 0.5]\nd1 = 0\n",
    "3-ups-sp": "A = [25, 60]\na = [10, 40]\nkite = [0.4, 1.0]\ntwist = [0, 0.8]\n",
    "4-ups-rps": "R1 = [500, 950]\nR = [450, 850]\nr = [120, 350]\n",
    "2uu-upu": "bs = [0.25, 0.5]\nps = [0.2, 0.45]\nL = [0.2, 0.4]\n",
}
MECHANISMS = tuple(RANGES)
#: What the other commands take, where the default design would say little.
DESIGNS = {
    "3-ups-sp": ("--params", "kite=0.6,twist=0.6"),
    "2pauu-ppap": ("--params", "m=1,n=0.7,l1=0.65,l2=1.5,c=0.1"),
}
#: Poses about home, and how far from it as a share of the coordinate or of 1.
POSES, NEAR = 10, 0.12
#: Of a manifest, what says where and when it was written.
PLACE = ("versions", "git_commit", "platform", "wall_time", "cpu_time", "outputs")


def answer(*arguments):
    """Return what a command prints; nothing reachable is an answer too."""
    from pmopt.cli import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main.run([str(a) for a in arguments])
    assert code in (0, 3), (arguments, err.getvalue())
    return out.getvalue()


def table_of(folder, columns, rows):
    """Write a table of numbers."""
    with open(folder, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(rows)


def poses_of(name):
    """Return poses about home, spread by whole numbers alone."""
    from pmopt.mechanisms import registry

    mechanism = registry.find(name)
    given = DESIGNS.get(name, ("", ""))[1]
    params = {k: float(v) for k, v in (p.split("=") for p in given.split(",") if p)}
    parameters = mechanism.resolve(params)
    home = mechanism.home(parameters)
    names = [c.name for c in mechanism.pose]
    rows = []
    for k in range(POSES):
        row = []
        for j, c in enumerate(names):
            share = (((k + 1) * (2 * j + 3) * 37) % 101) / 101 - 0.5
            row.append(home[c] + (NEAR * share * max(abs(home[c]), 1.0) if k else 0.0))
        rows.append(row)
    return names, [c.name for c in mechanism.joints], rows


def of_mechanism(folder, name):
    """Run every command on one mechanism."""
    folder.mkdir(parents=True, exist_ok=True)
    design = (*DESIGNS.get(name, ()), "--quiet")

    # Both forms of single poses; of runs one or the other, which print the same numbers.
    def keep(label, *arguments, forms=("json", "csv")):
        for form in forms:
            more = ("--force",) if "--out" in arguments else ()
            (folder / f"{label}.{form}").write_text(answer(*arguments, *more, "--format", form))

    names, joints, poses = poses_of(name)
    table_of(folder / "poses.csv", names, poses)
    keep("ik", "ik", name, "--poses", folder / "poses.csv", *design)
    found = list(csv.DictReader((folder / "ik.csv").open()))
    rows = [[row[j] for j in joints] for row in found if all(row.get(j) for j in joints)][:POSES]
    table_of(folder / "joints.csv", joints, rows)
    keep("fk", "fk", name, "--joints-file", folder / "joints.csv", *design)
    for k, pose in enumerate(poses[:6]):
        text = ",".join(f"{n}={v!r}" for n, v in zip(names, pose, strict=True))
        more = (("--norm", "fro"), ("--characteristic-length", "optimal"))[k % 2] if k > 1 else ()
        keep(f"jacobian-{k}", "jacobian", name, f"--pose={text}", *more, *design)
    few = ("--samples", 20_000, "--threads", 1)
    run = ("--out", folder / "workspace")
    keep("workspace", "workspace", name, *few, "--shape-grid", 8, *run, *design, forms=("json",))
    keep("optimal", "workspace", name, *few, "--characteristic-length", "optimal", "--sampler",
         "sobol", "--shape-grid", 0, *design, forms=("csv",))  # fmt: skip
    keep("aspect", "workspace", name, *few, "--norm", "fro", "--aspect", "home", "--shape-grid", 0,
         *design, forms=("json",))  # fmt: skip
    keep("grid", "workspace", name, "--grid", 9, "--threads", 1, "--shape-grid", 6, *design,
         forms=("csv",))  # fmt: skip
    keep("links", "workspace", name, *few, "--link-diameter", "1mm", "--cone-angle", 0.7, "--tool",
         "1mm,2mm,3mm", "--shape-grid", 0, *design, forms=("json",))  # fmt: skip
    if name == "2pauu-ppap":
        keep("certify", "workspace", name, "--certify", 0.1, *design)
    keep("singularities", "singularities", name, "--samples", 2048, "--grid", 6, "--threads", 1,
         "--out", folder / "singularities", *design, forms=("json",))  # fmt: skip
    table_of(folder / "path.csv", names, poses[:2])
    keep("crossings", "singularities", name, "--path", folder / "path.csv", *design,
         forms=("json",))  # fmt: skip
    keep("capability", "capability", name, "--samples", 2048, "--payload", 2, "--speed", 0.1,
         "--acceleration", 1, "--threads", 1, "--out", folder / "capability", *design,
         forms=("json",))  # fmt: skip
    keep("turning", "capability", name, "--samples", 1024, "--point-speed", 1, "--tool-force", 10,
         "--rotation-speed", 1, "--point-acceleration", 1, "--threads", 1, *design,
         forms=("csv",))  # fmt: skip
    config = folder / "search.toml"
    config.write_text(
        f'mechanism = "{name}"\n[parameters]\n{RANGES[name]}[algorithm]\npopulation = 12\n'
        "generations = 8\n[workspace]\nsamples = 500\n[final]\ntarget_error = 0.05\n"
    )
    quiet = ("--threads", 1, "--quiet")
    keep("pareto", "pareto", config, *quiet, "--out", folder / "pareto", forms=("json",))
    keep("adaptive", "pareto", config, *quiet, "--set", "workspace.samples=adaptive", "--set",
         "algorithm.seed=7", forms=("csv",))  # fmt: skip
    keep("batch", "batch", config, "--workers", 1, "--quiet", "--set", "algorithm.seed=1,2",
         "--set", "algorithm.generations=3", "--out", folder / "batch",
         forms=("json",))  # fmt: skip


def plain(path, folder):
    """Return a file's content without what says where, when and on what it was written."""
    text = path.read_text().replace(str(folder), "FOLDER")
    if path.suffix != ".json":
        return text
    return json.dumps(without_place(json.loads(text)), indent=1)


def without_place(document):
    """Return a document without what says when and on what it was written."""
    if isinstance(document, dict):
        return {k: without_place(v) for k, v in document.items() if k not in PLACE}
    return [without_place(v) for v in document] if isinstance(document, list) else document


def contents(folder):
    """Return by name what is to be the same everywhere: CSV and JSON, no pictures."""
    return {
        str(p.relative_to(folder)): plain(p, folder)
        for p in sorted(folder.rglob("*"))
        if p.suffix in (".csv", ".json") and "checkpoint" not in p.parts
    }


def draw_nothing():
    """Leave out the pictures, which are not compared."""
    from pmopt.reporting.runs import capability_run, run_pictures

    for module, name in (
        (run_pictures, "of_workspace"), (run_pictures, "of_singularities"),
        (run_pictures, "of_pareto"), (capability_run, "draw_capability"),
    ):  # fmt: skip
        setattr(module, name, lambda *_: {})


if __name__ == "__main__":
    draw_nothing()
    for mechanism in sys.argv[2:] or MECHANISMS:
        of_mechanism(Path(sys.argv[1]).resolve() / mechanism, mechanism)
