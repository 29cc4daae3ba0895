"""Many runs in one folder: what is planned, how it is run, and what stands on disk at the end."""

import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import time
import tomllib
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.cli_runner import (
    COMMAND,
    CONFIGS,
    TIMEOUT,
    Terminal,
    csv_rows,
    environment,
    error_line,
    here,
    pmopt,
    strict_json,
    wait_for,
)

import pmopt as package
from pmopt.errors import InputError, InputErrors, PmoptError
from pmopt.execution.workers import ATTEMPTS, LocalWorkers
from pmopt.mechanisms import find, names
from pmopt.reporting.batch import jobs
from pmopt.reporting.batch import run as batch_run
from pmopt.reporting.batch.jobs import Job, Outcome, run_job
from pmopt.reporting.batch.plan import (
    MAX_NAME,
    expand,
    find_configs,
    in_shard,
    parse_shard,
    plan_runs,
    unique_names,
)
from pmopt.reporting.batch.run import Batch
from pmopt.reporting.batch.runners import RUNNERS, Results, Runner, resolve
from pmopt.reporting.batch.shards import merge
from pmopt.reporting.runs.pareto_run import run_pareto

MECH = "2pauu-ppap"
TABLES = ["front.csv", "regions.csv", "history.csv", "evaluations.csv"]

PARETO = """\
mechanism = "2pauu-ppap"
[parameters]
m = [0.5, 1.5]
n = 0.7
l1 = [0.5, 1.5]
l2 = [0.5, 1.5]
c = 0.1
[workspace]
samples = 1000
[algorithm]
population = 12
generations = 4
[final]
target_error = 2e-2
"""
SWEEP = f"""{PARETO}
[sweep]
"algorithm.seed" = [1, 2]
parameters.n = [0.7, 0.8]
"""
WORKSPACE = """\
command = "workspace"
mechanism = "2pauu-ppap"
shape_grid = 0
[workspace]
samples = 2000
[sweep]
seed = [1, 2]
"""
#: Long enough to be hit in the middle.
LONG = f"""{PARETO.replace("generations = 4", "generations = 200")}
[sweep]
"algorithm.seed" = [1, 2, 3]
"""
INFEASIBLE = f"{PARETO}[constraints]\ngci = {{ min = 0.99 }}\n"


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Compile the kernels, or a first process says on stderr that it does."""
    package.workspace(MECH, samples=1000, shape_grid=0)


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a configuration and returns its path."""

    def written(name, text=PARETO):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return str(path)

    return written


def results(folder):
    """Return what must be the same bytes however a batch was run."""
    runs = sorted(p for p in (folder / "runs").rglob("*") if p.suffix == ".csv"
                  or p.name == "result.json")  # fmt: skip
    names = [folder / "summary.csv", *runs]
    return {str(path.relative_to(folder)): path.read_bytes() for path in names}


def summary(folder):
    return csv_rows((folder / "summary.csv").read_text(encoding="utf-8"))


def batch_of(tmp_path, *paths, out="out", shard=None):
    return Batch(plan_runs(map(str, paths)), tmp_path / out, shard)


def run(batch, pool=None, **options):
    """Run a batch in this process, or in a pool."""
    return batch.run(pool or Here(), notify=lambda text: None, **options)


class Here:
    """A pool of this process."""

    local = threads = 1
    running = ()

    def completed(self, function, items, tick):
        for number, item in enumerate(items):
            tick()
            yield number, function(item)


# --- sweeps ---------------------------------------------------------------------------------


def test_sweep_is_a_grid_whose_last_key_varies_fastest():
    data = tomllib.loads(SWEEP)
    grid = list(expand(data, "x"))
    assert [swept for swept, _ in grid] == [
        {"algorithm.seed": s, "parameters.n": n} for s in (1, 2) for n in (0.7, 0.8)
    ]
    for swept, variant in grid:
        assert "sweep" not in variant
        assert variant["algorithm"]["seed"] == swept["algorithm.seed"]
        assert variant["parameters"]["n"] == swept["parameters.n"]
        assert variant["parameters"]["m"] == [0.5, 1.5]
    assert data == tomllib.loads(SWEEP)  # left as it was


def test_without_a_sweep_there_is_one_run():
    assert list(expand({"mechanism": "x"}, "x")) == [({}, {"mechanism": "x"})]


BROKEN = {
    "sweep = 3": "sweep: a table of KEY = [VALUE, ..] is needed",
    "[sweep]": "sweep: a table of KEY = [VALUE, ..] is needed",
    "[sweep.workspace]": "sweep.workspace: a table of KEY = [VALUE, ..] is needed",
    "[sweep]\nmechanism = 'x'": "mechanism='x' is not allowed: a list, a range ",
    "[sweep]\nmechanism = []": "mechanism=[] is not allowed: a list, a range ",
    "[sweep]\na = [1, 2, 1]": "a: 1 is given twice",
    "[sweep]\na = [1, 2]\n'a.b' = [1]": "a.b is part of a: give one",
    "[sweep]\n'a..b' = [1]": "'a..b' is not a key of a configuration",
    "[sweep]\n'' = [1]": "'' is not a key of a configuration",
    "[sweep]\n'sweep.a' = [1]": "'sweep.a' is not a key of a configuration",
    "x = 1\n[sweep]\n'x.y' = [1]": "x.y: x is not a table",
}


@pytest.mark.parametrize(("text", "message"), BROKEN.items(), ids=BROKEN.values())
def test_broken_sweeps(text, message):
    with pytest.raises(InputError) as error:
        list(expand(tomllib.loads(text), "a.toml"))
    assert str(error.value).startswith("a.toml: sweep")
    assert message in str(error.value)


def test_sweep_of_too_many_runs_is_refused_before_it_is_made():
    axes = {f"k{i}": list(range(1000)) for i in range(6)}
    with pytest.raises(InputError, match="1000000000000000000 runs, allowed: at most 100000"):
        list(expand({"sweep": axes}, "a.toml"))


keys = st.from_regex(r"[a-c](\.[a-c]){0,2}", fullmatch=True)
values = st.one_of(
    st.integers(-3, 3), st.floats(allow_nan=False), st.text(max_size=4), st.booleans(),
    st.lists(st.floats(0, 1), min_size=2, max_size=2),
)  # fmt: skip
axes = st.dictionaries(keys, st.lists(values, min_size=1, max_size=3), min_size=1, max_size=4)


@given(axes)
def test_any_sweep_is_its_whole_grid_or_one_line(sweep):
    try:
        grid = list(expand({"mechanism": "x", "sweep": sweep}, "a.toml"))
    except InputError as error:
        parts = any(a != b and a.startswith(f"{b}.") for a in sweep for b in sweep)
        texts = [["_".join(map(str, x)) if isinstance(x, list) else str(x) for x in v]
                 for v in sweep.values()]  # fmt: skip
        twice = any(len(set(t)) < len(t) for t in texts)
        assert parts or twice, error
        return
    assert [swept for swept, _ in grid] == [
        dict(zip(sweep, point, strict=True)) for point in itertools.product(*sweep.values())
    ]
    for swept, variant in grid:
        assert variant["mechanism"] == "x"
        for key, value in swept.items():
            found = variant
            for name in key.split("."):
                found = found[name]
            assert found == value


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
junk = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)  # fmt: skip


@given(junk)
@example({"algorithm.seed": [1, True]})
@example({"mechanism": ["3-cur", {"a": 1}]})
def test_a_sweep_of_anything_runs_or_is_told_in_lines(sweep):
    """Whatever stands in the table, the plan is a list of runs or an error of the user's."""
    data = {**tomllib.loads(PARETO), "sweep": sweep}
    try:
        for _, variant in itertools.islice(expand(data, "a.toml"), 20):
            resolve(variant, "a.toml")
    except InputError as error:
        assert str(error).startswith("a.toml")


# --- names ----------------------------------------------------------------------------------

labels = st.lists(st.text(max_size=MAX_NAME + 20) | st.sampled_from(["a", "A", "..", "", "a/b"]),
                  max_size=8)  # fmt: skip


@given(labels)
@example(["..", ".", "", "../x", "/etc/passwd", "a\0b", "CON", "con.toml", "x" * 300, "x" * 301])
@example(["a/b", "a\\b", "a:b", "a_b", "A_B"])
def test_names_are_safe_and_unlike_each_other(labels):
    found = unique_names(labels, [f"{i} {label}" for i, label in enumerate(labels)])
    assert len({name.casefold() for name in found}) == len(labels)
    for name in found:
        assert re.fullmatch(r"[A-Za-z0-9_=+-][A-Za-z0-9._=+-]*", name)
        assert len(name) <= MAX_NAME
        assert not name.endswith(".")
        assert os.path.basename(os.path.normpath(f"out/runs/{name}")) == name


def test_a_name_does_not_depend_on_the_order_or_on_other_names():
    one = unique_names(["a", "b", "a"], ["1", "2", "3"])
    other = unique_names(["c", "a", "a", "b"], ["4", "3", "1", "2"])
    assert one == [other[2], other[3], other[1]]
    assert one[1] == "b"


def test_names_of_runs(write):
    paths = [write("a/x.toml"), write("b/x.toml"), write("s.toml", SWEEP)]
    found = [r.name for r in plan_runs(paths)]
    assert found[0] != found[1]
    assert all(re.fullmatch("x-[0-9a-f]{8}", name) for name in found[:2])
    assert found[2:] == [f"s-seed={s}-n={n}" for s in (1, 2) for n in (0.7, 0.8)]


def test_the_same_file_twice_is_one_run(write, tmp_path):
    path = write("a.toml")
    assert find_configs([path, str(tmp_path / "*.toml"), f"{tmp_path}/../{tmp_path.name}/a.toml"]) \
        == [path]  # fmt: skip


def test_a_file_with_the_name_of_a_glob_is_that_file(write):
    path = write("[a].toml")
    assert find_configs([path]) == [path]


# --- what is said before anything runs --------------------------------------------------------


def test_everything_wrong_is_told_at_once(write, tmp_path):
    """A line for each broken configuration of many, and nothing is run."""
    good = write("good.toml")
    write("typo.toml", PARETO.replace("population", "populaton"))
    write("sweep.toml", SWEEP.replace("0.8", "-0.8"))
    write("no.toml", "= 3")
    write("lines.toml", 'mechanism = "3-cur"\n[workspace]\nsampler = "lines"\nblock = "rotational"')
    write("which.toml", f'command = "paretto"\n{PARETO}')
    result = here("batch", str(tmp_path / "*.toml"), good, "--out", "out", cwd=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert all(line.startswith(f"error: {tmp_path}/") for line in lines)
    said = {Path(line.split(": ")[1]).name: line for line in lines}
    assert list(said) == ["lines.toml", "no.toml", "sweep.toml", "typo.toml", "which.toml"]
    assert said["sweep.toml"].endswith("(2 of 4 runs)")
    assert "n=-0.8" in said["sweep.toml"]
    assert "nearest: population" in said["typo.toml"]
    assert "nearest: pareto" in said["which.toml"]
    assert not (tmp_path / "out").exists()


def test_what_only_the_mechanism_refuses_is_told_before_anything_runs(write, tmp_path):
    other = next(name for name in names() if find(name).line is None)
    text = f'mechanism = "{other}"\n[workspace]\nsampler = "lines"\n'
    paths = [write("good.toml"), write("lines.toml", text)]
    result = here("batch", *paths, "--out", "out", cwd=tmp_path)
    assert error_line(result).startswith(f"error: {paths[1]}: workspace: sampler=lines is not")
    assert not (tmp_path / "out").exists()


USAGE = {
    ("nothing*.toml",): "nothing*.toml: no file matches",
    ("",): "CONFIG: '' is not the name of a file",
    (".",): ".: is a folder; a quoted glob like './*.toml' is needed",
    ("missing.toml",): "missing.toml: no such file",
    ("a.toml", "--shard", "6/5"): "--shard: '6/5' is not allowed: K/N with 1 <= K <= N, e.g. 2/5",
    ("a.toml", "--shard", "0/5"): "--shard: '0/5' is not allowed: K/N with 1 <= K <= N, e.g. 2/5",
    ("a.toml", "--resume"): "--resume needs --out, the folder of the run",
    ("a.toml", "--resume", "--force"): "--resume and --force exclude each other",
    ("a.toml", "--workers", "2", "--threads", "2"): "--workers and --threads exclude each other: "
    "one of them may be over 1",
    ("a.toml", "--workers", "2", "--scheduler", "tcp://a:1"): "--scheduler and --workers exclude "
    "each other: the cluster has its own",
    ("a.toml", "--scheduler", "nonsense"): "--scheduler: 'nonsense' is not an address like "
    "tcp://host:8786: missing port number in address 'nonsense'",
    ("a.toml", "--merge"): "--merge: a.toml holds no batch",
    ("a.toml", "--merge", "--workers", "2"): "--workers: not together with --merge, which runs "
    "nothing",
}  # fmt: skip


@pytest.mark.parametrize(("line", "message"), USAGE.items(), ids=[" ".join(k) for k in USAGE])
def test_usage(write, tmp_path, line, message):
    write("a.toml")
    assert error_line(here("batch", *line, cwd=tmp_path)) == f"error: {message}"
    assert [p.name for p in tmp_path.iterdir()] == ["a.toml"]


def test_pareto_says_whose_configuration_it_is(write, tmp_path):
    for path in (write("s.toml", SWEEP), write("w.toml", WORKSPACE)):
        assert "is the configuration of a batch" in error_line(here("pareto", path, cwd=tmp_path))
    path = write("p.toml", f'command = "pareto"\n{PARETO}')
    assert here("pareto", path, "--dry-run", cwd=tmp_path).returncode == 0


# --- whole batches ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Return the folder of configurations and that of a batch of them, in this process."""
    folder = tmp_path_factory.mktemp("undisturbed")
    for name, text in {"one": PARETO, "grid": SWEEP, "space": WORKSPACE}.items():
        (folder / f"{name}.toml").write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        batch = Batch(plan_runs(find_configs(["*.toml"])), folder / "out")
        assert run(batch).complete
    return folder


NAMES = [f"grid-seed={s}-n={n}" for s in (1, 2) for n in (0.7, 0.8)] + [
    "one", "space-seed=1", "space-seed=2",
]  # fmt: skip


def test_every_run_is_what_its_command_makes(undisturbed, tmp_path):
    folder = undisturbed / "out" / "runs"
    assert sorted(p.name for p in folder.iterdir()) == sorted(NAMES)
    for name, (_, variant) in zip(
        NAMES[:4], expand(tomllib.loads(SWEEP), "x"), strict=True
    ):  # fmt: skip
        run_pareto(resolve(variant, "x").config, tmp_path / name)
        for table in (*TABLES, "front.png"):
            assert (folder / name / table).read_bytes() == (tmp_path / name / table).read_bytes()
    alone = package.workspace(MECH, samples=2000, seed=2, shape_grid=0).to_dict()
    assert strict_json((folder / "space-seed=2" / "result.json").read_text()) == alone


def test_summary(undisturbed):
    rows = summary(undisturbed / "out")
    assert [row["name"] for row in rows] == NAMES
    assert {row["status"] for row in rows} == {"finished"}
    assert {row["mechanism"] for row in rows} == {MECH}
    assert [row["command"] for row in rows] == ["pareto"] * 5 + ["workspace"] * 2
    assert [row["parameters.n"] for row in rows] == ["0.7", "0.8", "0.7", "0.8", "", "", ""]
    assert [row["seed"] for row in rows] == [""] * 5 + ["1", "2"]
    for row in rows:
        folder = undisturbed / "out" / "runs" / row["name"]
        if row["command"] == "pareto":
            front = csv_rows((folder / "front.csv").read_text())
            assert row["best_volume"] == max(front, key=lambda r: float(r["volume"]))["volume"]
            assert row["best_gci_error"] == max(front, key=lambda r: float(r["gci"]))["gci_error"]
            assert row["designs"] == str(len(front))
            assert row["units"] == "hypervolume: m^3; volume: m^3"
        else:
            found = strict_json((folder / "result.json").read_text())
            assert float(row["volume"]) == found["volume"]["value"]
            assert float(row["volume_error"]) == found["volume"]["standard_error"]
            assert row["units"] == "volume: m^3"
    assert not any("time" in name for name in rows[0])


def test_footprint_is_best_where_it_is_least(tmp_path):
    folder = tmp_path / "x"
    folder.mkdir()
    (folder / "front.csv").write_text(
        "design,gci,footprint,gci_error,footprint_error\n1,0.2,3.0,0.01,0.3\n2,0.4,5.0,0.02,0.5\n"
    )
    knee = {"gci": 0.2, "gci_error": 0.01, "footprint": 3.0, "footprint_error": 0.3}
    manifest = {
        "config": {"objectives": ["gci", "footprint"]},
        "result": {
            "designs": 2,
            "hypervolume": 1.0,
            "knee": knee,
            "reference_point": {"gci": 0.0, "footprint": 9.0},
        },
        "units": {"gci": "1", "footprint": "m^2", "hypervolume": "m^2"},
    }
    found = RUNNERS["pareto"].results(folder, manifest)
    assert (found.values["best_gci"], found.values["best_gci_error"]) == (0.4, 0.02)
    assert (found.values["best_footprint"], found.values["best_footprint_error"]) == (3.0, 0.3)
    assert found.shown("best_footprint") == "3.00 ± 0.30 m^2"
    assert found.shown("reference_footprint") == "9 m^2"
    assert found.shown("best_gci") == "0.400 ± 0.020"


@pytest.mark.slow
def test_process_workers_and_glob(undisturbed, tmp_path):
    """As a process, on three worker processes: the same bytes, each run named, JSON on stdout."""
    out = tmp_path / "out"
    line = ("batch", "*.toml", "--workers", 3, "--out", out, "--format", "json")
    result = pmopt(*line, cwd=undisturbed)
    assert result.returncode == 0, result.stderr
    assert len(result.stderr.splitlines()) == len(NAMES)
    document = strict_json(result.stdout)
    assert document["counts"] == {"finished": len(NAMES)}
    assert [r["name"] for r in document["runs"]] == NAMES
    assert all(r["wall_time"] > 0 for r in document["runs"])
    assert document["units"] == {"wall_time": "s"}
    assert results(out) == results(undisturbed / "out")
    # Run again, nothing is left to do: no run is touched.
    times = {p: p.stat().st_mtime_ns for p in (out / "runs").rglob("*") if p.is_file()}
    again = pmopt(*line, cwd=undisturbed)
    assert (again.returncode, again.stderr) == (0, "")
    assert strict_json(again.stdout) == document
    assert {p: p.stat().st_mtime_ns for p in (out / "runs").rglob("*") if p.is_file()} == times
    assert results(out) == results(undisturbed / "out")


def test_forms(undisturbed, tmp_path):
    shutil.copytree(undisturbed / "out", tmp_path / "out")
    line = ("batch", "*.toml", "--out", str(tmp_path / "out"))
    text = here(*line, "--format", "csv", cwd=undisturbed).stdout
    assert text == (undisturbed / "out" / "summary.csv").read_text()
    table = here(*line, cwd=undisturbed).stdout
    assert "best_volume ± error (m^3)" in table
    assert "wall_time (s)" in table
    assert "7 finished of 7 runs" in table
    for name in NAMES:
        assert name in table
    result = here(*line, "--resume", cwd=undisturbed)
    assert (result.returncode, result.stdout) == (0, "")
    assert result.stderr.endswith("holds this batch, finished: nothing to do\n")


def test_a_run_begun_on_another_installation_goes_on(write, tmp_path):
    """It is said in a line with the run's name, and kept in its manifest."""
    batch = batch_of(tmp_path, write("one.toml"))
    run(batch)
    whole = results(batch.folder)
    folder = batch.folder / "runs" / "one"
    (folder / "manifest.json").unlink()
    (folder / "checkpoint" / "generation-0000004.bin").unlink()
    record = folder / "checkpoint" / "run.json"
    document = json.loads(record.read_text())
    document["installation"]["versions"]["numpy"] = "1.0"
    document["installation"]["processor"] = "Z80"
    record.write_text(json.dumps(document))
    lines = []
    assert batch.run(Here(), notify=lines.append).complete
    (line,) = lines
    assert line.startswith("one: resumed with numpy ")
    assert ", begun with 1.0; on " in line
    assert ", begun on Z80" in line
    assert json.loads((folder / "manifest.json").read_text())["resume_notes"] == [line[5:]]
    assert results(batch.folder).keys() == whole.keys()
    same = [k for k in whole if k != "summary.csv"]  # that has the time it took
    assert [k for k in same if results(batch.folder)[k] != whole[k]] == []


def test_a_run_that_fails_stops_no_other(write, tmp_path):
    paths = [write("a.toml", INFEASIBLE), write("b.toml", PARETO)]
    result = here("batch", *paths, "--workers", 2, "--out", "out", "--format", "json", cwd=tmp_path)
    assert result.returncode == 1
    runs = strict_json(result.stdout)["runs"]
    assert [r["status"] for r in runs] == ["infeasible", "finished"]
    assert runs[0]["message"].startswith("no feasible design: gci >= 0.99 rules out")
    rows = summary(tmp_path / "out")
    assert [row["status"] for row in rows] == ["infeasible", "finished"]
    assert rows[0]["message"] == runs[0]["message"]
    # It is tried again, and with what was in the way gone it ends well.
    before = results(tmp_path / "out")
    assert here("batch", *paths, "--out", "out", cwd=tmp_path).returncode == 1
    assert results(tmp_path / "out") == before


def test_a_configuration_that_changed_is_refused_by_name(write, undisturbed, tmp_path):
    shutil.copytree(undisturbed / "out", tmp_path / "out")
    path = write("one.toml", PARETO.replace("samples = 1000", "samples = 2000"))
    line = error_line(here("batch", path, "--out", "out", cwd=tmp_path))
    assert "runs/one: holds a run of another configuration: workspace.samples: 1000 -> 2000" in line
    more = write("one.toml", PARETO.replace("generations = 4", "generations = 6"))
    assert here("batch", more, "--out", "out", cwd=tmp_path).returncode == 0
    run_pareto(resolve(tomllib.loads(Path(more).read_text()), "x").config, tmp_path / "alone")
    for name in TABLES:
        assert (tmp_path / "out" / "runs" / "one" / name).read_bytes() == (
            tmp_path / "alone" / name
        ).read_bytes()
    other = write("one.toml", PARETO.replace("samples = 1000", "samples = 2000"))
    assert here("batch", other, "--out", "out", "--force", cwd=tmp_path).returncode == 0


def test_more_configurations_join_a_finished_batch(undisturbed, write, tmp_path):
    batch = batch_of(tmp_path, write("a.toml"))
    run(batch)
    stamp = (tmp_path / "out" / "runs" / "a" / "manifest.json").read_bytes()
    more = batch_of(tmp_path, write("a.toml"), write("w.toml", WORKSPACE))
    more.check(False)
    assert not more.finished()
    assert [r.name for r in run(more).runs] == ["a", "w-seed=1", "w-seed=2"]
    assert (tmp_path / "out" / "runs" / "a" / "manifest.json").read_bytes() == stamp


def test_folder_of_another_command_is_kept(undisturbed, write, tmp_path):
    batch = batch_of(tmp_path, write("a.toml"), out="other")
    shutil.copytree(undisturbed / "out" / "runs" / "one", tmp_path / "other")
    with pytest.raises(InputError, match="holds a finished pareto run, not a batch"):
        batch.check(False)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file, not a folder"):
        batch_of(tmp_path, write("a.toml"), out="file").check(False)


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("place", ["runs", "runs/a", "runs/a/checkpoint"])
def test_nothing_is_written_through_a_link(write, tmp_path, place, force):
    """Not even where a link in the folder points elsewhere, --force or not."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    link = tmp_path / "out" / place
    link.parent.mkdir(parents=True)
    link.symlink_to(elsewhere)
    options = ["--force"] if force else []
    result = here("batch", write("a.toml"), "--out", "out", *options, cwd=tmp_path)
    assert "is a symbolic link, a batch writes into its own folder only" in error_line(result)
    assert list(elsewhere.iterdir()) == []


def test_lock_is_no_way_out(write, tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("kept")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "batch.lock").symlink_to(precious)
    result = here("batch", write("a.toml"), "--out", "out", cwd=tmp_path)
    assert "out: cannot write: " in error_line(result, 1)
    assert precious.read_text() == "kept"


def test_folder_that_can_not_be_written(write, tmp_path):
    (tmp_path / "file").write_text("")
    result = here("batch", write("a.toml"), "--out", "file/out", cwd=tmp_path)
    assert error_line(result, 1) == "error: file/out: cannot write: Not a directory"


@pytest.mark.slow
def test_from_python(undisturbed, tmp_path, monkeypatch):
    monkeypatch.chdir(undisturbed)
    found = package.batch(["one.toml", Path("space.toml")], tmp_path / "out", workers=2)
    assert [r.name for r in found.runs] == ["one", "space-seed=1", "space-seed=2"]
    assert found.complete
    for name, data in results(tmp_path / "out").items():
        if name != "summary.csv":
            assert data == (undisturbed / "out" / name).read_bytes()


SHARES = {
    (8, 4, None, None): (4, 1), (8, None, None, None): (4, 1), (3, None, None, None): (1, 4),
    (8, None, 2, None): (1, 2), (8, None, 1, None): (4, 1), (8, 1, None, None): (1, 4),
    (8, 1, 3, None): (1, 3), (1, 8, 1, None): (8, 1), (4, None, None, None): (4, 1),
}  # fmt: skip


@pytest.mark.parametrize(("given", "expected"), SHARES.items())
def test_either_processes_or_threads(monkeypatch, given, expected):
    """On four cores: runs, workers, threads and scheduler to processes and threads of each."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", "4")
    share = batch_run.shares(*given)
    assert (share.workers, share.threads) == expected
    assert 1 in expected


def test_names_stay_in_the_folder(write, tmp_path):
    """Separators and dots in swept values lead nowhere."""
    text = f'{PARETO}[sweep]\n"workspace.working_mode" = ["out-in", "../../x"]\n'
    line = error_line(here("batch", write("a.toml", text), "--out", "out", cwd=tmp_path))
    assert "working_mode" in line
    runs = plan_runs([write("..toml", PARETO), write(".hidden.toml", PARETO)])
    assert [Path(r.name).name for r in runs] == [r.name for r in runs]
    assert not any(r.name.startswith(".") for r in runs)


def test_dry_run(undisturbed, tmp_path):
    result = here("batch", "*.toml", "--out", undisturbed / "out", "--dry-run", "--workers", 2,
                  "--format", "json", cwd=undisturbed)  # fmt: skip
    document = strict_json(result.stdout)
    assert [(g["command"], g["runs"], g["finished"], g["probed"]) for g in document["groups"]] == [
        ("pareto", 5, 5, 0), ("workspace", 2, 2, 0),
    ]  # fmt: skip
    assert document["estimated_time"] == 0
    result = here("batch", "*.toml", "--out", tmp_path / "new", "--dry-run", "--workers", 2,
                  "--format", "json", cwd=undisturbed)  # fmt: skip
    document = strict_json(result.stdout)
    assert [(g["runs"], g["finished"], g["probed"]) for g in document["groups"]] == [
        (5, 0, 2), (2, 0, 2),
    ]  # fmt: skip
    times = [g["cpu_time"] for g in document["groups"]]
    assert all(t > 0 for t in times)
    assert document["estimated_time"] == sum(times) / 2
    assert not (tmp_path / "new").exists()


def test_what_is_shipped_is_a_batch(tmp_path):
    batch = batch_of(tmp_path, *sorted((CONFIGS / "batch").glob("*.toml")))
    batch.check(False)
    commands = {r.name: r.runner.command for r in batch.runs}
    assert commands == {
        **{f"links-l2={x}-seed={s}": "pareto" for x in (0.8, 1.1, 1.4) for s in (1, 2)},
        **{f"sizes-link_diameter={x}": "workspace" for x in (10.0, 20.0)},
    }


@pytest.mark.slow
def test_motions_are_runs_too(write, tmp_path, monkeypatch):
    """Known by their trajectory; a recording whose content has changed is another run."""
    monkeypatch.chdir(tmp_path)
    for name in ("2uu-upu-t1", "2uu-upu-eq16", "3-ups-sp-strokes"):
        shutil.copy(CONFIGS / "motion" / f"{name}.toml", tmp_path)
    shutil.copy(CONFIGS / "motion" / "3-ups-sp-strokes.csv", tmp_path)
    line = ("batch", "*.toml", "--out", "out", "--workers", 2)
    result = here(*line, "--format", "json", cwd=tmp_path)
    assert result.returncode == 1, result.stderr
    runs = strict_json(result.stdout)["runs"]
    assert [(r["command"], r["status"]) for r in runs] == [
        ("motion", "infeasible"), ("motion", "finished"), ("motion", "finished"),
    ]  # fmt: skip
    assert runs[0]["message"].startswith("2uu-upu-eq16.toml: infeasible at ")
    rows = csv_rows((tmp_path / "out/runs/2uu-upu-t1/summary.csv").read_text())
    peaks = {f"{r['joint']}_{r['quantity']}_peak": float(r["peak"]) for r in rows
             if r["quantity"] in ("effort", "power")}  # fmt: skip
    assert runs[1]["results"] == peaks
    assert runs[1]["units"]["delta3_effort_peak"] == "N m"
    assert runs[2]["units"]["l1_effort_peak"] == "N"
    alone = package.motion(tmp_path / "2uu-upu-t1.toml", tmp_path / "alone")
    assert alone.infeasible == ()
    assert (tmp_path / "alone/motion.csv").read_bytes() == (
        tmp_path / "out/runs/2uu-upu-t1/motion.csv"
    ).read_bytes()
    stamp = (tmp_path / "out/runs/3-ups-sp-strokes/manifest.json").read_bytes()
    assert here(*line, cwd=tmp_path).returncode == 1
    assert (tmp_path / "out/runs/3-ups-sp-strokes/manifest.json").read_bytes() == stamp
    path = tmp_path / "3-ups-sp-strokes.csv"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    assert "trajectory.sha256: " in error_line(here(*line, cwd=tmp_path))
    path.unlink()
    assert "3-ups-sp-strokes.csv" in error_line(here(*line, cwd=tmp_path))


def test_another_command_joins_by_a_class(write, tmp_path, monkeypatch):
    class Echo(Runner):
        command, marks = "echo", ("say",)

        def __init__(self, data):
            self.data = data

        @classmethod
        def resolve(cls, data, where):
            if not isinstance(data["say"], str):
                raise InputError(f"{where}: say={data['say']!r} is not allowed: a text is needed")
            return cls(data)

        mechanism = MECH

        def document(self):
            return self.data

        def ready(self, notify=None):
            return None

        def run(self, folder, *, force, threads, beat=None):
            made = batch_run.RunFolder(folder, force)
            made.open()
            made.write("said.txt", self.data["say"])
            made.close("echo", {"config": self.data})

        def plan(self, threads, notify):
            raise NotImplementedError

        @classmethod
        def results(cls, folder, manifest):
            return Results({"length": len((folder / "said.txt").read_text())}, {"length": "m"})

    monkeypatch.setitem(RUNNERS, "echo", Echo)
    path = write("e.toml", '[sweep]\nsay = ["a", "bcd"]')
    found = run(batch_of(tmp_path, path))
    assert [r.results.values for r in found.runs] == [{"length": 1}, {"length": 3}]
    assert found.runs[1].headline == "e-say=bcd: finished, length 3 m"
    with pytest.raises(InputErrors, match="say=3 is not allowed"):
        plan_runs([write("f.toml", "say = 3")])


@pytest.mark.slow
def test_live_view(long_batch, tmp_path):
    """On a terminal: what is done of all runs, and of those at work; stdout stays clean."""
    path, _ = long_batch
    terminal = Terminal("batch", str(path), "--workers", "2", "--out", "out", "--format", "csv",
                        cwd=tmp_path)  # fmt: skip
    terminal.read()
    code, output = terminal.close()
    assert code == 0
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", terminal.text)
    for done in range(4):
        assert f"{done} of 3 runs" in text
    shares = re.findall(r"long-seed=1 [^\n%]* (\d+) % ETA", text)
    assert any(0 < int(share) < 100 for share in shares)
    assert text.count("long-seed=3: finished, designs") == 1
    assert output == (tmp_path / "out" / "summary.csv").read_text()


# --- shards -----------------------------------------------------------------------------------


@given(st.integers(1, 12), st.integers(0, 40))
def test_every_run_is_in_one_shard(shards, count):
    parts = [[k for k in range(count) if in_shard(k, (s, shards))] for s in range(1, shards + 1)]
    assert sorted(itertools.chain(*parts)) == list(range(count))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    assert parse_shard(f"{shards}/{shards}") == (shards, shards)


@pytest.mark.slow
def test_shards_merge_to_the_summary_of_the_whole(undisturbed, tmp_path):
    folders = [tmp_path / f"shard-{k}" for k in (1, 2, 3)]
    for k in (3, 1):
        result = here("batch", "*.toml", "--shard", f"{k}/3", "--out", folders[k - 1],
                      cwd=undisturbed)  # fmt: skip
        assert result.returncode == 0, result.stderr
    ran = [{r["name"] for r in summary(folders[k])} for k in (0, 2)]
    assert ran == [set(NAMES[0::3]), set(NAMES[2::3])]
    # A part is missing: its runs are named, and the exit code says so.
    result = here("batch", "--merge", folders[0], folders[2], "--out", tmp_path / "some",
                  "--format", "csv", cwd=tmp_path)  # fmt: skip
    assert result.returncode == 1
    pending = [r["name"] for r in csv_rows(result.stdout) if r["status"] == "pending"]
    assert pending == NAMES[1::3]
    here("batch", "*.toml", "--shard", "2/3", "--out", folders[1], cwd=undisturbed)
    result = here("batch", "--merge", *folders[::-1], "--out", tmp_path / "all", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    whole = (undisturbed / "out" / "summary.csv").read_bytes()
    assert (tmp_path / "all" / "summary.csv").read_bytes() == whole
    assert "finished run" in error_line(
        here("batch", "--merge", *folders, "--out", tmp_path / "all", cwd=tmp_path)
    )
    assert "is one of the shards" in error_line(
        here("batch", "--merge", *folders, "--out", folders[0], "--force", cwd=tmp_path)
    )
    assert "holds 1/3 of a batch, this is 2/3 of one" in error_line(
        here("batch", "*.toml", "--shard", "2/3", "--out", folders[0], cwd=undisturbed)
    )


def test_shards_of_different_batches_are_not_merged(write, tmp_path):
    one = batch_of(tmp_path, write("a.toml"), out="one")
    other = batch_of(tmp_path, write("a.toml", PARETO.replace("1000", "1500")), out="other")
    for batch in (one, other):
        run(batch)
    with pytest.raises(InputError, match=r"holds a part of another batch than .*: config_sha256: "):
        merge([one.folder, other.folder], tmp_path / "all")
    with pytest.raises(InputError, match="holds no batch"):
        merge([tmp_path / "nowhere"], tmp_path / "all")


# --- interruptions ------------------------------------------------------------------------------


def start(folder, path, *options):
    """Start a batch of long runs; Ctrl-C may be ignored where the tests run."""
    return subprocess.Popen(
        ["env", "--default-signal=INT,QUIT", *COMMAND, "batch", path, "--out", str(folder),
         *map(str, options)],
        cwd=folder.parent, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip


def generations(folder):
    return len(list((folder / "runs").glob("*/checkpoint/generation-*.bin")))


def children(process):
    """Return the processes that a process has started, and theirs."""
    import psutil

    return psutil.Process(process.pid).children(recursive=True)


def gone(processes):
    import psutil

    return not psutil.wait_procs(processes, timeout=5)[1]


@pytest.fixture(scope="module")
def long_batch(tmp_path_factory):
    """Return a configuration of long runs and the folder of an undisturbed batch of it."""
    folder = tmp_path_factory.mktemp("long")
    (folder / "long.toml").write_text(LONG)
    batch = Batch(plan_runs([str(folder / "long.toml")]), folder / "out")
    assert run(batch).complete
    return folder / "long.toml", folder / "out"


@pytest.mark.slow
def test_killed_and_run_again(long_batch, tmp_path):
    """Killed without a chance to tidy up: the workers end too, and the next run goes on."""
    path, whole = long_batch
    out = tmp_path / "out"
    for enough in (20, 250):
        process = start(out, path, "--workers", 2)
        wait_for(lambda: generations(out) >= enough, process)  # noqa: B023
        workers = children(process)
        process.kill()
        process.communicate()
        assert gone(workers)
    assert not (out / "manifest.json").exists()
    done = generations(out)
    assert enough <= done < 3 * 200
    result = pmopt("batch", path, "--workers", 2, "--out", out, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert results(out) == results(whole)
    resumed = [json.loads(p.read_text())["resumes"] for p in out.glob("runs/*/manifest.json")]
    assert sum(map(len, resumed)) >= 2
    assert not list(out.glob("*.lock"))


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_and_continued_as_it_says(long_batch, tmp_path, number):
    path, whole = long_batch
    out = tmp_path / "out"
    process = start(out, path, "--workers", 2)
    wait_for(lambda: generations(out) >= 20, process)
    workers = children(process)
    began = time.monotonic()
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does: the workers get it, too
    else:
        process.send_signal(number)
    _, err = process.communicate(timeout=TIMEOUT)
    assert time.monotonic() - began < 5
    assert process.returncode == 130
    assert "Traceback" not in err
    last = err.splitlines()[-1]
    assert last.startswith("error: interrupted; continue with: pmopt batch ")
    assert gone(workers)
    hint = last.partition("continue with: pmopt ")[2].split()
    result = pmopt(*hint, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert results(out) == results(whole)


@pytest.mark.slow
def test_worker_process_killed(long_batch, tmp_path):
    """A worker that is killed costs nothing: another one goes on with its run."""
    path, whole = long_batch
    out = tmp_path / "out"
    process = start(out, path, "--workers", 2)
    wait_for(lambda: generations(out) >= 20, process)
    victims = [p for p in children(process) if "spawn_main" in " ".join(p.cmdline())]
    assert len(victims) == 2
    victims[0].kill()
    _, err = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, err
    assert results(out) == results(whole)


def test_two_batches_do_not_write_one_folder(long_batch, tmp_path):
    path, _ = long_batch
    out = tmp_path / "out"
    process = start(out, path, "--workers", 1)
    try:
        wait_for(lambda: generations(out) >= 1, process)
        result = here("batch", path, "--out", out, cwd=tmp_path)
        line = error_line(result)
        assert f"out: is being written by process {process.pid} on " in line
        assert f": pmopt batch {path} " in line
    finally:
        process.kill()
        process.communicate()


def dies(item):
    if item == 1:
        os._exit(7)
    return item * 10


def test_an_item_that_kills_every_process_is_given_up():
    with LocalWorkers(2) as pool:
        found = dict(pool.completed(dies, [0, 1, 2], lambda: None))
    assert (found[0], found[2]) == (0, 20)
    assert str(found[1]) == f"its process died {ATTEMPTS} times (exit code 7; out of memory?)"


def test_a_run_whose_batch_has_gone_stops(tmp_path, monkeypatch):
    """A worker on another machine, whose batch was killed, notices by the file of its key."""
    monkeypatch.setattr(jobs, "_BEAT", 0.0)
    document = resolve(tomllib.loads(PARETO), "x").document()
    lock = tmp_path / "batch.lock"
    lock.write_text("mine")
    job = Job("pareto", document, "a.toml", str(tmp_path / "run"), False, 1, str(lock), "mine")
    runner = RUNNERS["pareto"]
    running = runner.run

    def then_gone(self, folder, *, force, threads, beat=None):
        lock.write_text("another's")
        running(self, folder, force=force, threads=threads, beat=beat)

    monkeypatch.setattr(runner, "run", then_gone)
    assert run_job(job).status == "pending"
    assert not (tmp_path / "run" / "manifest.json").exists()


@pytest.mark.slow
def test_a_worker_that_does_not_see_the_folder_sends_the_files(undisturbed, write, tmp_path):
    class Far(Here):
        """Workers on a machine of their own."""

        local = 0

        def completed(self, function, items, tick):
            for number, item in enumerate(items):
                far = Job(**{**vars(item), "lock": "/nowhere/batch.lock", "folder": "/nowhere"})
                yield number, function(far)

    class Lies(Here):
        def completed(self, function, items, tick):
            yield 0, Outcome(files={"../../precious": b""})

    with pytest.raises(PmoptError, match="a worker sent a file of the name"):
        run(batch_of(tmp_path, write("a.toml"), out="lies"), Lies())
    assert not (tmp_path / "lies" / "precious").exists()
    batch = Batch(plan_runs([str(undisturbed / f"{n}.toml") for n in ("grid", "one", "space")]),
                  tmp_path / "out")  # fmt: skip
    assert run(batch, Far()).complete
    assert results(tmp_path / "out") == results(undisturbed / "out")


# --- on a Dask cluster ----------------------------------------------------------------------------


@pytest.mark.slow
def test_on_a_cluster(undisturbed, cluster, tmp_path):
    out = tmp_path / "out"
    result = pmopt("batch", "*.toml", "--scheduler", cluster.scheduler_address, "--out", out,
                   "--format", "csv", cwd=undisturbed)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert len(result.stderr.splitlines()) == len(NAMES)
    assert results(out) == results(undisturbed / "out")
    assert result.stdout == (undisturbed / "out" / "summary.csv").read_text()


@pytest.mark.slow
def test_worker_of_a_cluster_killed(long_batch, cluster, tmp_path):
    """Killed in the middle of a run, which another worker goes on with."""
    path, whole = long_batch
    out = tmp_path / "out"
    process = start(out, path, "--scheduler", cluster.scheduler_address)
    wait_for(lambda: generations(out) >= 20, process)
    os.kill(next(iter(cluster.workers.values())).process.process.pid, signal.SIGKILL)
    _, err = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, err
    assert results(out) == results(whole)


@pytest.mark.slow
def test_interrupted_on_a_cluster(long_batch, cluster, tmp_path):
    path, whole = long_batch
    out = tmp_path / "out"
    process = start(out, path, "--scheduler", cluster.scheduler_address)
    wait_for(lambda: generations(out) >= 20, process)
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=TIMEOUT)
    assert time.monotonic() - began < 5
    assert process.returncode == 130
    assert "Traceback" not in err
    result = pmopt("batch", path, "--out", out, "--scheduler", cluster.scheduler_address,
                   cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert results(out) == results(whole)
