"""Dask as it fails: one line within the promised time, and a run that is taken up again."""

import http.server
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from support.cli_runner import TIMEOUT, environment, error_line, here, wait_for

from pmopt.execution import scheduler
from pmopt.reporting.batch.runners import WorkspaceRunner
from pmopt.reporting.runs.workspace_run import run_workspace

MECH = "2pauu-ppap"
COMMANDS = {
    "workspace": ("workspace", MECH),
    "pareto": ("pareto", "a.toml"),
    "batch": ("batch", "a.toml"),
}


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Return a folder with a configuration; patience is short."""
    monkeypatch.setattr("pmopt.execution.cluster._PATIENCE", 1.5)
    (tmp_path / "a.toml").write_text(f'mechanism = "{MECH}"\n')
    return tmp_path


@pytest.fixture
def silent():
    """Return the address of a port that accepts connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield f"127.0.0.1:{listening.getsockname()[1]}"


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def web():
    """Return the address of a web server."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()


def refused(home, command, address):
    line = error_line(here(*COMMANDS[command], "--out", "out", "--scheduler", address, cwd=home), 1)
    head = f"error: --scheduler: no Dask scheduler answers at {address}"
    assert line.startswith(head)
    assert [p.name for p in home.iterdir()] == ["a.toml"]
    return line.removeprefix(head)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_port_that_says_nothing(home, silent, command):
    assert refused(home, command, f"tcp://{silent}").startswith(": what listens there says nothing")


def test_the_port_of_another_service(home, web):
    assert refused(home, "workspace", f"tcp://{web}")


def test_a_host_that_is_none(home):
    tail = refused(home, "workspace", "tcp://no-such-host.invalid:8786")
    assert tail in (": there is no host of that name", "")  # "": nobody to ask for names


def test_without_certificates(home, silent):
    tail = refused(home, "workspace", f"tls://{silent}")
    assert tail.startswith(": it takes certificates: DASK_DISTRIBUTED__COMM__TLS__CA_FILE, ")


def test_a_port_that_is_none(home):
    result = here("workspace", MECH, "--scheduler", "tcp://127.0.0.1:99999", cwd=home)
    assert "port 99999 is not from 1 to 65535" in error_line(result)


def test_the_address_of_a_worker(home, cluster):
    address = next(iter(cluster.workers.values())).worker_address
    assert refused(home, "workspace", address) == ": it is a worker, not the scheduler"


def test_notices_come_after_5_10_20_seconds(monkeypatch):
    """And begin anew when what was waited for has come and gone again."""
    clock, lines = [0.0], []
    monkeypatch.setattr(scheduler.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(scheduler.Watch, "_ask", lambda self: None)
    watch = scheduler.Watch("tcp://a:1", lines.append)

    def at(second, threads):
        clock[0] = second
        watch._answers.put(scheduler.Answer(threads))
        watch.look()

    for second in range(31):
        at(float(second), 0)
    at(31.0, 2)
    for second in range(32, 38):
        at(float(second), 0)
    assert lines == [f"waiting for workers at tcp://a:1, {n} s" for n in (5, 10, 20, 30, 5)]


# --- processes ---------------------------------------------------------------------------------

#: The command line with shorter patience: the notice comes before the end.
IMPATIENT = """
from pmopt.execution import scheduler
scheduler.PATIENCE, scheduler.SILENT, scheduler.WITHOUT, scheduler._NOTICE = 2.0, 6.0, 6.0, 1.0
from pmopt.reporting.runs import workspace_checkpoint
workspace_checkpoint.EVERY = 0.0
from pmopt.cli import entry
entry.main()
"""
DASK = [sys.executable, "-m", "distributed.cli.dask_"]


class Dask:
    """A scheduler and a worker as processes, with what ends them however a test ends."""

    def __init__(self, folder, *options):
        self.folder = folder
        self.options = options
        self.processes = []
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        scheme = "tls" if options else "tcp"
        self.address = f"{scheme}://127.0.0.1:{port}"
        self.scheduler = self.start("scheduler", "--host", self.address, "--port", str(port),
                                    "--dashboard-address", "127.0.0.1:0")  # fmt: skip
        self.worker = self.start_worker()

    def start_worker(self):
        return self.start("worker", self.address, "--nthreads", "1", "--no-nanny", "--host",
                          "127.0.0.1", "--no-dashboard")  # fmt: skip

    def start(self, what, *words):
        process = subprocess.Popen(
            [*DASK[:-1], f"{DASK[-1]}{what}", *words, *self.options], cwd=self.folder,
            env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self.processes.append(process)
        return process

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture
def dask(tmp_path):
    found = Dask(tmp_path)
    yield found
    found.end()


LARGE = ("workspace", MECH, "--samples", 400_000_000, "--shape-grid", 0, "--out", "run")
SEARCH = f"""
mechanism = "{MECH}"
[parameters]
n = 0.7
c = 0.1
[workspace]
samples = 2_000_000
[algorithm]
population = 20
generations = 30
[final]
target_error = 0.05
"""
RUNS = {
    "workspace": (LARGE, "run/checkpoint/chunk-*"),
    "pareto": (("pareto", "search.toml", "--out", "run"), "run/checkpoint/generation-*"),
    "batch": (("batch", "search.toml", "--out", "run"), "run/runs/*/checkpoint/generation-*"),
}


def begin(folder, words, address):
    return subprocess.Popen(
        [sys.executable, "-c", IMPATIENT, *map(str, words), "--scheduler", address], cwd=folder,
        env=environment(), text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def kill_the_worker(dask):
    dask.worker.kill()


def kill_the_scheduler(dask):
    dask.scheduler.kill()


def stop_the_scheduler(dask):
    os.kill(dask.scheduler.pid, signal.SIGSTOP)


ENDS = {
    kill_the_worker: "has no workers left, for 6 s",
    kill_the_scheduler: "has gone",
    stop_the_scheduler: "has not answered for 6 s",
}


@pytest.mark.slow
@pytest.mark.parametrize("what", RUNS)
@pytest.mark.parametrize("fault", ENDS)
def test_in_the_middle(dask, tmp_path, fault, what):
    (tmp_path / "search.toml").write_text(SEARCH)
    words, mark = RUNS[what]
    process = begin(tmp_path, words, dask.address)
    wait_for(lambda: len(list(tmp_path.glob(mark))) >= 2, process)
    fault(dask)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    *before, last = errors.splitlines()
    assert last == f"error: the scheduler at {dask.address} {ENDS[fault]}"
    allowed = ("waiting for ", "generation ", "compiling")
    assert [line for line in before if not line.startswith(allowed)] == []
    if fault is not kill_the_scheduler:
        assert any(line.startswith("waiting for ") for line in before)
    assert not (tmp_path / "run" / "manifest.json").exists()
    assert not [p.name for p in (tmp_path / "run").iterdir() if p.name.startswith(".pmopt")]
    assert list(tmp_path.glob(mark))


@pytest.mark.slow
def test_workers_that_come_back_in_time(dask, tmp_path):
    process = begin(tmp_path, LARGE, dask.address)
    wait_for(lambda: list(tmp_path.glob(RUNS["workspace"][1])), process)
    kill_the_worker(dask)
    time.sleep(2)
    dask.start_worker()
    _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, errors
    task = WorkspaceRunner.resolve(
        {"mechanism": MECH, "workspace": {"samples": LARGE[3]}, "shape_grid": 0}, "x"
    ).task
    run_workspace(task, tmp_path / "alone")
    for name in ("result.json", "regions.csv", "lci_histogram.csv"):
        assert (tmp_path / "run" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


@pytest.fixture
def certificates(tmp_path):
    """Return Dask's options for a certificate made for this test."""
    files = [str(tmp_path / name) for name in ("certificate.pem", "key.pem")]
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj",
               "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1",
               "-out", files[0], "-keyout", files[1]]  # fmt: skip
    try:
        if subprocess.run(command, capture_output=True).returncode:
            pytest.skip("no certificate can be made here")
    except FileNotFoundError:
        pytest.skip("there is no openssl here")
    return files


@pytest.mark.slow
def test_with_certificates(tmp_path, certificates, monkeypatch):
    """Dask's own settings are taken; without, or with others, there is one line."""
    certificate, key = certificates
    own = Dask(tmp_path, "--tls-ca-file", certificate, "--tls-cert", certificate, "--tls-key", key)
    words = ("workspace", MECH, "--samples", 1000, "--shape-grid", 0, "--quiet", "--format", "json")
    head = "DASK_DISTRIBUTED__COMM__TLS__"
    settings = {f"{head}CA_FILE": certificate, f"{head}CLIENT__CERT": certificate,
                f"{head}CLIENT__KEY": key}  # fmt: skip

    def run(address=own.address, **changes):
        for name in settings:
            monkeypatch.delenv(name, raising=False)
        for name, value in changes.items():
            monkeypatch.setenv(name, value)
        return begin(tmp_path, words, address).communicate(timeout=60)

    try:
        found, errors = run(**settings)
        assert errors == ""
        assert found == here(*words, cwd=tmp_path).stdout
        for changes, reason in (
            ({}, "it takes certificates"),
            (settings | {f"{head}CA_FILE": str(tmp_path / "none")}, "No such file"),
            (settings | {f"{head}CA_FILE": key}, "certificate"),
        ):
            _, errors = run(**changes)
            assert errors.startswith(
                f"error: --scheduler: no Dask scheduler answers at {own.address}:"
            )
            assert reason in errors
            assert errors.count("\n") == 1
        _, errors = run(own.address.replace("tls", "tcp"))
        assert errors.startswith("error: --scheduler: no Dask scheduler answers at tcp://")
        assert errors.count("\n") == 1
    finally:
        own.end()
