"""Configurations to start from: every shipped one, and one of each kind for each mechanism."""

import importlib.util
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from support.cli_runner import (
    CONFIGS,
    answer,
    csv_answer,
    environment,
    error_line,
    files_in,
    here,
    json_answer,
)

from pmopt.analysis.motion.config import load_motion
from pmopt.analysis.motion.trajectories import plan_trajectory
from pmopt.inputs import examples as module
from pmopt.inputs.examples import advice, advice_for_pattern, examples, find_example
from pmopt.inputs.identify import kind_of_config
from pmopt.mechanisms import find, names
from pmopt.reporting.batch.plan import plan_runs
from pmopt.reporting.runs.motion_run import run_motion
from pmopt.reporting.runs.starting_config import KINDS
from pmopt.synthesis.config import load_config

ROOT = CONFIGS.parent
NAMES = [example.name for example in examples()]
MECH = "2pauu-ppap"


def test_every_file_of_configs_is_of_one_example():
    belonging = [path for e in examples() for path in (e.path, *e.beside)]
    assert sorted(belonging) == sorted(CONFIGS / name for name in files_in(CONFIGS)
                                       if "__pycache__" not in name)  # fmt: skip
    assert len(belonging) == len(set(belonging))
    assert {"quickstart", "motion/2uu-upu-t1", "batch/links"} <= set(NAMES)


def load(kind, path):
    """Read a configuration as its command does, as far as it goes without computing."""
    if kind == "pareto":
        return load_config(path)
    if kind == "motion":
        return plan_trajectory(load_motion(path))
    return plan_runs([str(path)])


@pytest.mark.parametrize("name", NAMES)
def test_an_example_is_what_configs_has_and_is_read_anywhere(name, tmp_path):
    found = find_example(name)
    data = tomllib.loads(found.path.read_text())
    assert kind_of_config(data) in (found.kind, None)
    assert found.mechanism in names()
    assert len(found.about) > 20
    written = json_answer("init", "--example", name, "--out", "sub/my.toml", cwd=tmp_path)
    beside = [p.name for p in found.beside]
    assert written["files"] == ["sub/my.toml", *(f"sub/{n}" for n in beside)]
    assert written["run"] == f"pmopt {found.kind} sub/my.toml"
    assert (tmp_path / "sub/my.toml").read_bytes() == found.path.read_bytes()
    for path in found.beside:
        assert (tmp_path / "sub" / path.name).read_bytes() == path.read_bytes()
    assert len(files_in(tmp_path)) == 1 + len(beside)
    assert load(found.kind, tmp_path / "sub/my.toml")


def test_names_of_an_example(tmp_path):
    for name in ("motion/2uu-upu-t1", "2uu-upu-t1", "configs/motion/2UU-UPU-t1.toml"):
        assert find_example(name).name == "motion/2uu-upu-t1"
    line = error_line(here("init", "--example", "quikstart", cwd=tmp_path))
    assert "nearest: quickstart" in line
    assert error_line(here("init", "--example", "", cwd=tmp_path))
    assert answer("init", "--example", "quickstart", "--out", "-", cwd=tmp_path) == (
        (CONFIGS / "quickstart.toml").read_text()
    )
    result = here("init", "--example", "3-ups-sp-strokes", "--out", "-", cwd=tmp_path)
    assert "3-ups-sp-strokes.csv" in result.stderr
    assert files_in(tmp_path) == []


def test_nothing_is_overwritten(tmp_path):
    """Whole or not at all: neither the configuration nor what it refers to."""
    words = ("init", "--example", "3-ups-sp-strokes")
    answer(*words, cwd=tmp_path)
    before = files_in(tmp_path)
    assert len(before) == 3
    assert "3-ups-sp-strokes.toml exists" in error_line(here(*words, cwd=tmp_path))
    answer(*words, "--out", "other.toml", cwd=tmp_path)  # beside it lies what it needs
    (tmp_path / "3-ups-sp-strokes.csv").write_text("mine")
    line = error_line(here(*words, "--out", "third.toml", cwd=tmp_path))
    assert "3-ups-sp-strokes.csv exists" in line
    assert "--force" in line
    assert files_in(tmp_path) == sorted([*before, "other.toml"])
    assert (tmp_path / "3-ups-sp-strokes.csv").read_text() == "mine"
    answer(*words, "--force", cwd=tmp_path)
    assert (tmp_path / "3-ups-sp-strokes.csv").read_text() != "mine"
    (tmp_path / "link.toml").symlink_to("nowhere")
    assert "link.toml exists" in error_line(here("init", "--out", "link.toml", cwd=tmp_path))
    (tmp_path / "3-ups-sp-strokes.csv").unlink()
    (tmp_path / "3-ups-sp-strokes.csv").mkdir()
    error_line(here(*words, "--out", "fourth.toml", "--force", cwd=tmp_path), 1)
    assert not (tmp_path / "fourth.toml").exists()


def test_the_list(tmp_path):
    found = json_answer("init", "--list", cwd=tmp_path)
    assert [e["example"] for e in found["examples"]] == NAMES
    assert [k["kind"] for k in found["kinds"]] == list(KINDS)
    assert found["kinds"][0]["mechanisms"] == names()
    rows = csv_answer("init", "--list", cwd=tmp_path)
    assert [row["example"] for row in rows if row["table"] == "example"] == NAMES
    assert [row["kind"] for row in rows if row["table"] == "kind"] == list(KINDS)
    assert files_in(tmp_path) == []
    assert "--list" in error_line(here("init", "--list", "motion", cwd=tmp_path))


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_for_each_mechanism(kind, mechanism, tmp_path):
    written = json_answer("init", kind, mechanism.name, cwd=tmp_path)
    path = tmp_path / written["written"]
    assert written["run"] == f"pmopt {KINDS[kind].command} {path.name}"
    assert files_in(tmp_path) == [path.name]
    assert tomllib.loads(path.read_text())["mechanism"] == mechanism.name
    assert load(KINDS[kind].command, path)
    if kind == "motion":
        assert not run_motion(load_motion(path), threads=1).infeasible


def test_what_stands_in_comments_is_allowed(tmp_path):
    """A line that shows a default or an example is one, once its mark is gone."""
    for kind in ("workspace", "motion"):
        answer("init", kind, "3-cur", "--out", f"{kind}.toml", cwd=tmp_path)
        lines = (tmp_path / f"{kind}.toml").read_text().splitlines()
        head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
        bare = [line.removeprefix("# ") for line in lines[head:]]
        (tmp_path / f"{kind}.toml").write_text("\n".join(bare))
        assert load(KINDS[kind].command, tmp_path / f"{kind}.toml")


def test_kind_and_mechanism(tmp_path):
    assert json_answer("init", "motion", cwd=tmp_path)["written"] == f"{MECH}-motion.toml"
    assert json_answer("init", "3-CUR", "Motion", cwd=tmp_path)["written"] == "3-cur-motion.toml"
    assert json_answer("init", "3 cur", cwd=tmp_path)["written"] == "3-cur.toml"
    for words, part in {
        ("motoin",): "nearest: motion",
        ("motion", "3-cr"): "nearest: 3-cur",
        ("motion", "pareto"): "one KIND and one MECH",
        ("3-cur", MECH): "one KIND and one MECH",
        ("motion", "--example", "quickstart"): "not together with motion",
    }.items():
        assert part in error_line(here("init", *words, cwd=tmp_path)), words


WRITES = {
    "pareto configs/quickstart.toml": "quickstart --out configs/quickstart.toml writes it",
    "pareto configs/quickstart.toml --dry-run --set algorithm.seed=2": "init --example quickstart",
    "pareto quickstart.toml --out run --resume": "pmopt init --example quickstart writes it",
    "pareto quickstart": "pmopt init --example quickstart writes quickstart.toml",
    "motion configs/motion/2uu-upu-t1.toml": "motion/2uu-upu-t1 --out configs/motion/2uu-upu-t1",
    "simulate 2uu-upu-t1.toml": "pmopt init --example motion/2uu-upu-t1 writes it",
    "batch configs/batch/links.toml": "batch/links --out configs/batch/links.toml writes it",
    "batch configs/*.toml": "pmopt init --list names",
    f"workspace {MECH} --params @configs/quickstart.toml": "--example quickstart --out configs",
    "ik 3-ups-sp --poses 3-ups-sp-strokes.csv": "--example motion/3-ups-sp-strokes",
}


@pytest.mark.parametrize("words", WRITES)
def test_what_a_page_names_and_is_not_there(words, tmp_path):
    """One line that says what writes it; and then it is there."""
    line = error_line(here(*words.split(), cwd=tmp_path))
    assert "no such file" in line or "no file matches" in line
    assert WRITES[words] in line
    if " writes " in line:
        answer(*line.partition("; pmopt ")[2].partition(" writes ")[0].split(), cwd=tmp_path)
        named = next(
            word for word in words.split()[1:] if "quick" in word or "/" in word or "." in word
        )
        found = files_in(tmp_path)
        assert named.lstrip("@") in found or f"{named}.toml" in found


def test_no_advice_for_what_is_no_example():
    for name in ("", "configs", "my.toml", "quickstart.csv", "configs/motion/quickstart.toml"):
        assert advice(Path(name)) == "", name
    assert advice_for_pattern("studies/*.toml") == ""
    assert "'my folder/configs/quickstart.toml'" in advice(
        Path("my folder/configs/quickstart.toml")
    )


def test_a_package_without_its_examples(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "folder", lambda: tmp_path / "none")
    monkeypatch.setattr(module, "examples", module.examples.__wrapped__)
    assert advice(Path("configs/quickstart.toml")) == ""
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "edited.toml").write_text("# Half done. More\nmechanism =")
    (found,) = module.examples()
    assert (found.name, found.about, found.mechanism) == ("edited", "Half done.", "")


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """Return the package with what pyproject.toml says goes into a wheel, elsewhere."""
    place = tmp_path_factory.mktemp("unpacked")
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"][
        "targets"
    ]["wheel"]
    assert wheel["packages"] == ["src/pmopt"]
    shutil.copytree(ROOT / "src/pmopt", place / "pmopt",
                    ignore=shutil.ignore_patterns("__pycache__"))  # fmt: skip
    for source, target in wheel["force-include"].items():
        shutil.copytree(ROOT / source, place / target)
    return place


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return a wheel, unpacked."""
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling, which builds wheels, is not installed")
    place = tmp_path_factory.mktemp("built")
    script = (
        "import sys; from hatchling.builders.wheel import WheelBuilder as B;"
        "print(*B(sys.argv[1]).build(directory=sys.argv[2], versions=['standard']))"
    )
    done = subprocess.run([sys.executable, "-c", script, str(ROOT), str(place)],
                          capture_output=True, text=True, check=True)  # fmt: skip
    with zipfile.ZipFile(done.stdout.strip()) as archive:
        archive.extractall(place / "site")
    return place / "site"


def outside(place, *words, cwd):
    """Run an unpacked package as a process."""
    script = f"import pmopt; assert pmopt.__file__.startswith({str(place)!r}), pmopt.__file__\n"
    script += "from pmopt.cli.entry import main; main()"
    return subprocess.run([sys.executable, "-c", script, *words], cwd=cwd, capture_output=True,
                          text=True, env=environment(PYTHONPATH=str(place)))  # fmt: skip


def check_outside(place, tmp_path):
    done = outside(place, "init", "--example", "quickstart", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "quickstart.toml").read_bytes() == (CONFIGS / "quickstart.toml").read_bytes()
    done = outside(place, "init", "--list", "--format", "csv", cwd=tmp_path)
    rows = [line.split(",") for line in done.stdout.splitlines()]
    assert [row[1] for row in rows if row[0] == "example"] == NAMES
    words = ("--set", "algorithm.generations=2", "--set", "algorithm.population=8", "--out", "run",
             "--quiet", "--format", "csv")  # fmt: skip
    done = outside(place, "pareto", "quickstart.toml", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run/manifest.json").is_file()
    done = outside(place, "pareto", "configs/quickstart.toml", cwd=tmp_path)
    assert "pmopt init --example quickstart --out configs/quickstart.toml" in error_line(done)


def test_an_unpacked_package(unpacked, tmp_path):
    check_outside(unpacked, tmp_path)


def test_a_wheel(built, tmp_path):
    check_outside(built, tmp_path)
    assert files_in(built / "pmopt/configs") == [
        name for name in files_in(CONFIGS) if "__pycache__" not in name
    ]
    assert (built / "pmopt/py.typed").is_file()
    (info,) = built.glob("*.dist-info")
    metadata = (info / "METADATA").read_text()
    assert "Description-Content-Type: text/markdown" in metadata
    assert "# pmopt\n" in metadata
    assert "pmopt = pmopt.cli.entry:main" in (info / "entry_points.txt").read_text()
    assert {name.split("/")[0] for name in files_in(built)} == {"pmopt", info.name}
    assert find(MECH)
