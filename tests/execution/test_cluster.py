"""One run spread over a cluster: the same bytes, whatever happens to its workers."""

import builtins
import json
import os
import signal
import subprocess
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from support.cli_runner import (
    COMMAND,
    TIMEOUT,
    environment,
    error_line,
    here,
    strict_json,
    wait_for,
)

from pmopt.analysis.sampling import blocks
from pmopt.analysis.sampling.measuring import Course
from pmopt.analysis.sampling.partial_sums import Sums
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import block_ranges
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.errors import InputError, PmoptError
from pmopt.execution.cluster import Cluster, _Task
from pmopt.mechanisms import find
from pmopt.reporting.batch.runners import WorkspaceRunner
from pmopt.reporting.runs.pareto_run import run_pareto
from pmopt.reporting.runs.workspace_run import run_workspace
from pmopt.synthesis import problem as problem_module
from pmopt.synthesis.config import resolve_config
from pmopt.synthesis.problem import DesignProblem, evaluate_part

MECH = "2pauu-ppap"
TABLES = ["front.csv", "regions.csv", "history.csv", "evaluations.csv"]
#: Several blocks, the last one not whole.
SEVERAL = 3 * (1 << 22) + 100_000


@pytest.fixture(scope="module")
def client(cluster):
    with Cluster(cluster.scheduler_address) as found:
        yield found


# --- workspace -------------------------------------------------------------------------------

SETTINGS = {
    "r-sequence": {"samples": SEVERAL},
    "sobol": {"samples": SEVERAL, "sampler": "sobol", "replicates": 12},
    "lines": {"samples": SEVERAL, "sampler": "lines"},
    "monte-carlo": {"samples": SEVERAL, "sampler": "monte-carlo", "min_lci": 0.2},
    "grid": {"grid": 230},
    "target": {"target_error": 2e-5, "sampler": "lines"},
    "optimal": {"samples": 100_000, "characteristic_length": "optimal"},
    "aspect": {"samples": 20_000, "aspect": "home"},
    "block": {"samples": 20_000, "block": "translational"},
    "limits": {"samples": 100_000, "limits": {"theta1": (-0.5, float("inf"))}},
}


@pytest.mark.parametrize("name", SETTINGS)
def test_workspace_on_a_cluster_is_the_same(client, name):
    mechanism, settings = find(MECH), WorkspaceSettings(**SETTINGS[name])
    one, two, spread = (
        compute_workspace(mechanism, {}, settings, seed=3, shape_grid=0, **where).to_dict()
        for where in (
            {"threads": 1},
            {"threads": 2},
            {"threads": 1, "course": Course(cluster=client)},
        )
    )
    assert json.dumps(one) == json.dumps(two) == json.dumps(spread)


def test_several_blocks_are_what_is_tested():
    assert len(list(block_ranges(0, SEVERAL // 16, 16))) == 4


def test_blocks_come_in_order_and_are_told(client):
    mechanism = find(MECH)
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1)
    design, points = sampler.design(mechanism.resolve({})), sampler.sequence(16)
    ends = []
    spread = list(blocks.blocks_on(client, sampler, design, points, 7, 800_000, ends.append))
    assert ends == [stop for _, stop in block_ranges(7, 800_000, 16)]
    own = list(sampler.blocks(design, points, 7, 800_000, lambda count: None))
    assert len(own) == len(spread) == len(ends) > 2
    for a, b in zip(own, spread, strict=True):
        assert a.points == b.points
        assert a.total.tobytes() == b.total.tobytes()
        assert a.histogram.tobytes() == b.histogram.tobytes()


def test_a_run_begun_here_ends_on_a_cluster_and_back(client):
    """What was kept of a run goes on anywhere."""
    mechanism, settings = find(MECH), WorkspaceSettings(samples=SEVERAL)
    kept: dict[int, Sums] = {}

    def keep(sums):
        kept[sums.chunks] = sums

    options = {"shape_grid": 0, "threads": 1}
    whole = compute_workspace(
        mechanism, {}, settings, course=Course(keep=keep), **options
    ).to_dict()
    assert len(kept) == 3
    for sums in kept.values():
        course = Course(sums, cluster=client)
        on = compute_workspace(mechanism, {}, settings, course=course, **options)
        assert on.to_dict() == whole


def start(*args, cwd):
    return subprocess.Popen(
        ["env", "--default-signal=INT,QUIT", *COMMAND, *map(str, args)], cwd=cwd,
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def kill_a_worker(cluster):
    os.kill(next(iter(cluster.workers.values())).process.process.pid, signal.SIGKILL)


LARGE = ("workspace", MECH, "--samples", 3_000_000_000, "--shape-grid", 0, "--format", "json")


@pytest.fixture(scope="module")
def large():
    settings = WorkspaceSettings(samples=LARGE[3])
    return compute_workspace(find(MECH), {}, settings, shape_grid=0).to_dict()


@pytest.mark.slow
def test_workspace_survives_its_workers_and_an_interruption(cluster, large, tmp_path):
    """A worker killed, the run interrupted, taken up again, another worker killed."""
    line = (*LARGE, "--out", "out", "--scheduler", cluster.scheduler_address)
    process = start(*line, cwd=tmp_path)
    checkpoint = tmp_path / "out" / "checkpoint"
    wait_for(lambda: list(checkpoint.glob("chunk-*")), process)
    kill_a_worker(cluster)
    began = time.monotonic()
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, time.monotonic() - began < 5) == (130, True), err
    assert "Traceback" not in err
    process = start(*line, "--resume", cwd=tmp_path)
    wait_for(lambda: len(json.loads((checkpoint / "run.json").read_text())["resumes"]), process)
    kill_a_worker(cluster)
    out, err = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, err
    assert strict_json(out) == large
    manifest = strict_json((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["resumes"][0] > 0


def test_files_of_a_workspace_are_the_same(client, tmp_path):
    data = {"mechanism": MECH, "workspace": {"samples": SEVERAL}, "shape_grid": 8}
    task = WorkspaceRunner.resolve(data, "x").task
    run_workspace(task, tmp_path / "here", threads=2)
    run_workspace(task, tmp_path / "there", threads=2, cluster=client)
    for name in ("result.json", "regions.csv", "lci_histogram.csv", "workspace.png"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()


# --- pareto -----------------------------------------------------------------------------------

PARETO = {
    "mechanism": MECH,
    "parameters": {"n": 0.7, "c": 0.1},
    "workspace": {"samples": 2000},
    "algorithm": {"population": 20, "generations": 6},
    "final": {"target_error": 1e-2},
}
CHANGES = {
    "fixed": {},
    "adaptive": {"workspace": {"sampler": "lines"}},
    "target": {"workspace": {"target_error": 0.05}},
    "space": {"objectives": ["projected_volume", "gci", "footprint"]},
    "bounds": {
        "constraints": {"gci": {"min": 0.3}},
        "workspace": {"samples": 2000, "min_lci": 0.1},
    },
}


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.slow
def test_search_on_a_cluster_is_the_same(client, tmp_path, name):
    config = resolve_config({**PARETO, **CHANGES[name]}, "x")
    places = {"one": {"threads": 1}, "two": {"threads": 2}, "far": {"cluster": client}}
    for place, where in places.items():
        run_pareto(config, tmp_path / place, **where)
    for table in TABLES:
        found = {(tmp_path / place / table).read_bytes() for place in places}
        assert len(found) == 1, table


@pytest.mark.slow
def test_search_survives_its_workers_and_an_interruption(cluster, tmp_path):
    data = {**PARETO, "algorithm": {"population": 20, "generations": 150}}
    run_pareto(resolve_config(data, "x"), tmp_path / "alone")
    path = tmp_path / "a.toml"
    path.write_text(
        f'mechanism = "{MECH}"\nparameters = {{n = 0.7, c = 0.1}}\nworkspace.samples = 2000\n'
        "algorithm = {population = 20, generations = 150}\nfinal.target_error = 1e-2\n"
    )
    line = ("pareto", path, "--out", "out", "--scheduler", cluster.scheduler_address)
    process = start(*line, cwd=tmp_path)
    checkpoint = tmp_path / "out" / "checkpoint"
    wait_for(lambda: len(list(checkpoint.glob("generation-*"))) >= 5, process)
    kill_a_worker(cluster)
    wait_for(lambda: len(list(checkpoint.glob("generation-*"))) >= 15, process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    result = here(*line, "--resume", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for table in TABLES:
        assert (tmp_path / "out" / table).read_bytes() == (tmp_path / "alone" / table).read_bytes()


def test_designs_that_fail_on_a_worker_are_told(client, monkeypatch):
    """What a worker found wrong with single designs reaches the one who asked."""
    problem = DesignProblem(resolve_config(PARETO, "x"), cluster=client)
    reasons = {(1.0, 2.0): "no root", (1.5, 2.0): "no root"}
    sent = evaluate_part

    def with_reasons(part):
        return replace(sent(part), reasons=reasons)

    monkeypatch.setattr(problem_module, "evaluate_part", with_reasons)
    monkeypatch.setattr(client, "ordered_map", lambda function, items: map(function, items))
    problem.evaluate(np.array([problem.lower, problem.upper]))
    assert problem.failures == {"no root": 2}


# --- the cluster itself -------------------------------------------------------------------------


def square(number):
    return number * number


def fails(number):
    raise ValueError(f"no {number}")


def refuses(number):
    raise InputError(f"not {number}")


def test_results_are_in_order_and_an_endless_iterable_is_no_harm(client):
    taken = []

    def numbers():
        for n in range(10**9):
            taken.append(n)
            yield n

    found = client.ordered_map(square, numbers())
    assert [next(found) for _ in range(100)] == [n * n for n in range(100)]
    found.close()
    assert len(taken) < 300
    assert list(client.ordered_map(square, [])) == []


@pytest.mark.parametrize(("function", "message"), [
    (fails, r"on the cluster at tcp://.*: ValueError: no 3"), (refuses, "^not 3$"),
])  # fmt: skip
def test_what_fails_there_is_told_here(client, function, message):
    with pytest.raises(PmoptError, match=message):
        list(client.ordered_map(function, [3]))


def test_another_version_is_refused(client, monkeypatch):
    monkeypatch.setattr("pmopt.execution.cluster.__version__", "0.0.0")
    with pytest.raises(PmoptError, match=r"^a worker has pmopt .*, this is 0\.0\.0$"):
        list(client.ordered_map(square, [3]))
    assert _Task(square, "0.0.0")(3) == 9


def dies(number):
    os._exit(1)


@pytest.mark.slow
def test_an_item_that_kills_every_worker_is_given_up():
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as own,
        Cluster(own.scheduler_address) as client,
    ):
        found = dict(client.completed(dies, [1], lambda: None))
    assert str(found[0]) == "the workers that ran it died, one after the other"


def test_a_scheduler_that_goes_is_told():
    from distributed import LocalCluster

    own = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")
    with Cluster(own.scheduler_address) as client:
        stop = threading.Timer(1.0, own.close)
        stop.start()
        with pytest.raises(PmoptError, match=r"^the scheduler at tcp://.* has gone$"):
            for _ in client.ordered_map(time.sleep, [0.2] * 1000):
                pass
        stop.join()


@pytest.mark.parametrize("command", ["workspace", "pareto", "batch"])
@pytest.mark.parametrize(("address", "message", "code"), [
    ("nonsense", "--scheduler: 'nonsense' is not an address like tcp://host:8786: missing port "
     "number in address 'nonsense'", 2),
    ("tcp://127.0.0.1:9", "--scheduler: no Dask scheduler answers at tcp://127.0.0.1:9", 1),
])  # fmt: skip
def test_addresses(tmp_path, monkeypatch, command, address, message, code):
    monkeypatch.setattr("pmopt.execution.cluster._PATIENCE", 0.5)
    (tmp_path / "a.toml").write_text(f'mechanism = "{MECH}"\n')
    what = MECH if command == "workspace" else "a.toml"
    result = here(command, what, "--out", "out", "--scheduler", address, cwd=tmp_path)
    assert error_line(result, code) == f"error: {message}"
    assert [p.name for p in tmp_path.iterdir()] == ["a.toml"]


def test_without_dask(tmp_path, monkeypatch):
    imported = builtins.__import__

    def without(name, *rest):
        if name.split(".")[0] == "distributed":
            raise ImportError(name)
        return imported(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    result = here("workspace", MECH, "--scheduler", "tcp://a:1", cwd=tmp_path)
    assert error_line(result) == (
        "error: --scheduler: Dask is not installed; pip install 'pmopt[cluster]' installs it"
    )


def test_scheduler_without_workers(tmp_path, monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr("pmopt.execution.cluster._PATIENCE", 0.5)
    with LocalCluster(n_workers=0, dashboard_address=":0") as own:
        address = own.scheduler_address
        line = error_line(here("workspace", MECH, "--scheduler", address, cwd=tmp_path), 1)
    assert line == f"error: --scheduler: {address} has no workers"
