"""What any input has to end in, a function for each kind of input; see :mod:`support.fuzzing`."""

import shutil
import tempfile
from pathlib import Path

from hypothesis import strategies as st

from support import fuzzing
from support.fuzzing import ends_well, folder, run
from support.killing import outputs


def poses(example):
    """Check one line of ``ik``, ``fk`` or ``jacobian``."""
    words, table = example
    with folder() as cwd:
        if table is not None:
            (cwd / "input.csv").write_bytes(table)
        return ends_well(run(words, cwd), cwd, ["input.csv"])


def workspaces(words):
    """Check one line of ``workspace``."""
    with folder() as cwd:
        (cwd / "input.csv").write_bytes(b"a file\n")
        allowed = ["input.csv"]
        if "--out" in words:
            out = words[words.index("--out") + 1]
            allowed += ["run"] if out != "." else FILES
        result = run(words, cwd)
        assert (cwd / "input.csv").read_bytes() == b"a file\n"
        return ends_well(result, cwd, allowed)


FILES = ["manifest.json", "result.json", "lci_histogram.csv", "regions.csv"]


def searches(raw):
    """Check one configuration of ``pareto``."""
    with folder() as cwd:
        (cwd / "input.toml").write_bytes(raw)
        result = run(["pareto", "input.toml", "--out", "run", "--quiet"], cwd)
        return ends_well(result, cwd, ["input.toml", "run"])


def motions(example):
    """Check one configuration of ``motion``, with or without a table of points."""
    raw, table = example
    with folder() as cwd:
        (cwd / "input.toml").write_bytes(raw)
        if table is not None:
            (cwd / "input.csv").write_bytes(table)
        result = run(["motion", "input.toml", "--out", "run", "--quiet"], cwd)
        how = ends_well(result, cwd, ["input.toml", "input.csv", "run"])
        assert (cwd / "run").exists() == (how == "success")
        return how


def capabilities(words):
    """Check one line of ``capability``."""
    with folder() as cwd:
        return ends_well(run([*words, "--quiet"], cwd), cwd)


SMALL = """
mechanism = "2pauu-ppap"
[parameters]
m = [0.5, 1.5]
[workspace]
samples = 200
[algorithm]
population = 6
generations = 4
[final]
target_error = 0.3
"""
RUNS = {
    "pareto": ["pareto", "input.toml"],
    "workspace": ["workspace", "2pauu-ppap", "--samples", str(3 << 22), "--shape-grid", "0"],
}


def begun(command, kept):
    """Return the folder of a run that was cut off after its last checkpoint, and its outputs."""
    if command not in kept:
        kept[command] = Path(tempfile.mkdtemp(prefix="pmopt-fuzz-"))
        cwd = kept[command]
        (cwd / "input.toml").write_text(SMALL)
        assert run([*RUNS[command], "--out", "whole", "--quiet"], cwd).returncode == 0
        shutil.copytree(cwd / "whole" / "checkpoint", cwd / "run" / "checkpoint")
    return kept[command]


def checkpoints(example, kept):
    """Check a run that is taken up from checkpoints that something has been done to."""
    command, data = example
    source = begun(command, kept)
    with folder() as cwd:
        shutil.copytree(source, cwd, dirs_exist_ok=True)
        files = sorted((cwd / "run" / "checkpoint").iterdir())
        changed = []
        for _ in range(data.draw(st.integers(1, 2))):
            path = data.draw(st.sampled_from(files))
            raw = data.draw(fuzzing.mangled(path.read_bytes()) | st.binary(max_size=300))
            other = data.draw(st.sampled_from(files))
            how = data.draw(st.sampled_from(["bytes", "bytes", "bytes", "another", "gone", "new"]))
            if how == "gone":
                path.unlink(missing_ok=True)
            elif how == "new":
                path.with_name(data.draw(st.sampled_from(NAMES))).write_bytes(raw)
            else:
                path.write_bytes(other.read_bytes() if how == "another" and other.exists() else raw)
            changed.append((path.name, how))
            files = [path for path in files if path.exists()]
        result = run([*RUNS[command], "--out", "run", "--resume"], cwd)
        how = ends_well(result, cwd, ["input.toml", "run", "whole"])
        if how == "success":
            assert outputs(cwd / "run") == outputs(cwd / "whole"), changed
        else:
            assert "run.json" in result.stderr, (changed, result.stderr)
        return how


#: Files that are none of a run's, or of no number it has reached.
NAMES = ["generation-0000009.bin", "chunk-0000007.bin", "generation-x.bin", "-.bin",
         "x-\u0663.bin"]  # fmt: skip
